"""Matrix kernels of OpenBLAS for the processor.

OpenBLAS identifies processors by their model number. On a processor newer than itself a release
takes its oldest kernels (Prescott, of 2004): 0.3.21 of Debian 12 multiplies matrices on Emerald
Rapids at a fifth of the speed of its best kernels. Here the instruction set chooses the kernels.
"""

import ctypes
import re
from contextlib import suppress
from pathlib import Path

CPUINFO, MAPS = Path("/proc/cpuinfo"), Path("/proc/self/maps")

# OPENBLAS_CORETYPE -> instructions that the kernels need; the best kernels first.
KERNELS = {"SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl"}, "Haswell": {"avx2", "fma"}}


def best_kernels(cpuinfo: Path = CPUINFO) -> str | None:
    """Name of the best kernels that every OpenBLAS has and the processor can run.

    Args:
        cpuinfo: file in which Linux describes the processor.

    Returns:
        Value for OPENBLAS_CORETYPE, which OpenBLAS reads when it is loaded; None where the
        instruction set is not known or too old, and the choice is left to OpenBLAS.
    """
    with suppress(OSError), cpuinfo.open() as lines:
        flags = next((set(line.split()) for line in lines if line.startswith("flags")), set())
        return next((name for name, needed in KERNELS.items() if needed <= flags), None)
    return None


def kernels_in_use() -> str:
    """Releases and kernels of the OpenBLAS libraries that this process has loaded; "" of none."""
    files, found = set[str](), set[str]()
    with suppress(OSError):
        files |= {*re.findall(r"/\S*openblas\S*", MAPS.read_text("utf-8"))}
    for file in files:
        library = ctypes.CDLL(file)
        for name in ("openblas_get_config", "scipy_openblas_get_config64_"):
            if (function := getattr(library, name, None)) is not None:
                function.restype = ctypes.c_char_p
                words = (function() or b"").decode(errors="replace").split()
                # The release, and the kernels in front of the largest number of threads.
                found.add(" ".join([*words[:2], *words[-2:-1]]))
    return ", ".join(sorted(found))
