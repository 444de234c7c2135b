"""Public functions of the package and of ``micro`` show an example, and each gives its number."""

import doctest
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from mpi4py import MPI

import numpy as np
import pytest

import brake_fenicsx
from brake_fenicsx import micro
from brake_fenicsx.surface import Topography, given_statistics
from places import ROOT

FUNCTIONS = [
    function
    for home in (brake_fenicsx, micro)
    for function in (getattr(home, name) for name in home.__all__)
    if not isinstance(function, type)
]
# What the examples of a module use from others.
NAMES = {name: getattr(micro, name) for name in micro.__all__} | {
    "np": np, "MPI": MPI, "replace": replace, "Path": Path, "Topography": Topography,
    "TemporaryDirectory": TemporaryDirectory, "given_statistics": given_statistics,
}  # fmt: skip


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_example(function, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = NAMES | vars(sys.modules[function.__module__])
    (test,) = doctest.DocTestFinder(recurse=False).find(function, globs=names)
    found = doctest.DocTestRunner().run(test)
    assert found.attempted > 0 and found.failed == 0
