"""Matrix kernels of OpenBLAS for the processor.

OpenBLAS tells processors by their model number. A release knows none that came after it and takes
its oldest kernels for them (Prescott, of 2004): 0.3.21, which Debian 12 has, on Emerald Rapids, for
one, multiplies matrices five times slower than it can. What the instructions allow does not age.
"""

from __future__ import annotations

from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")

# OPENBLAS_CORETYPE -> what it takes; better ones first.
KERNELS = {
    "SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl"},
    "Haswell": {"avx2", "fma"},
}


def best_kernels(cpuinfo: Path = CPUINFO) -> str | None:
    """Name of the best kernels that every OpenBLAS has and the processor can run.

    Args:
        cpuinfo: what Linux says of the processor.

    Returns:
        Value for OPENBLAS_CORETYPE, which is read when the library is loaded; None where nothing
        is known, and OpenBLAS had better choose.
    """
    try:
        with cpuinfo.open() as lines:
            flags = next((set(line.split()) for line in lines if line.startswith("flags")), set())
    except OSError:
        return None
    return next((name for name, needed in KERNELS.items() if needed <= flags), None)
