"""Matrix kernels of OpenBLAS: those of the processor, whether OpenBLAS knows it or not."""

import os
import subprocess
import sys

import pytest

from brake_fenicsx.libraries import CPUINFO, best_kernels
from source_tree import ROOT

# What the library that NumPy loaded says, on its own line; nothing where that is not OpenBLAS.
ASK = """
import os
import brake_fenicsx.cli
import ctypes
import numpy
paths = {line.split()[-1] for line in open("/proc/self/maps") if "openblas" in line}
library = ctypes.CDLL(min(paths)) if paths else None
ask = getattr(library, "openblas_get_corename", None)
if ask is not None:
    ask.restype = ctypes.c_char_p
    print(os.environ.get("OPENBLAS_CORETYPE"), ask().decode())
"""


@pytest.mark.parametrize(
    ("flags", "name"),
    [
        ("fpu sse2 ssse3 avx2 fma avx512f avx512dq avx512cd avx512bw avx512vl", "SkylakeX"),
        # Knights Landing has no 512-bit instructions for small integers.
        ("fpu sse2 avx2 fma avx512f avx512cd avx512er avx512pf", "Haswell"),
        ("fpu sse2 ssse3 avx avx2 fma bmi2", "Haswell"),
        ("fpu sse2 ssse3 avx", None),
    ],
)
def test_the_instructions_choose(tmp_path, flags, name):
    file = tmp_path / "cpuinfo"
    file.write_text(f"processor\t: 0\nmodel\t\t: 999\nflags\t\t: {flags}\nbugs\t\t: none\n")
    assert best_kernels(file) == name


def test_nothing_is_chosen_where_nothing_is_known(tmp_path):
    assert best_kernels(tmp_path / "none") is None
    arm = tmp_path / "cpuinfo"
    arm.write_text("processor\t: 0\nFeatures\t: fp asimd evtstrm\n")
    assert best_kernels(arm) is None


@pytest.mark.parametrize("given", [None, "Prescott"])
def test_the_command_takes_them_before_the_library_is_loaded(given):
    own = {n: v for n, v in os.environ.items() if n != "OPENBLAS_CORETYPE"}
    own |= {} if given is None else {"OPENBLAS_CORETYPE": given}
    wanted = given or best_kernels(CPUINFO)
    run = subprocess.run([sys.executable, "-c", ASK], env=own, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    if not run.stdout or wanted is None:
        pytest.skip("no OpenBLAS with several kernels, or a processor that is not known")
    name, core = run.stdout.split()
    assert name == wanted
    assert core.lower() == wanted.lower()


def test_kernels_of_another_processor_are_those_that_work_here():
    """Asked for by hand, some end in a crash with OpenBLAS 0.3.34 (Debian unstable)."""
    words = [sys.executable, str(ROOT / "scripts" / "other_kernel")]
    name = subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    product = "import numpy as np; a = np.ones((900, 900)); assert np.all(a @ a == 900)"
    own = os.environ | {"OPENBLAS_CORETYPE": name}
    assert name and subprocess.run([sys.executable, "-c", product], env=own).returncode == 0
