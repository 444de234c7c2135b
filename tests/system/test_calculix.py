"""Modes against CalculiX: another program, its own elements, contact and friction."""

import shutil
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"),
]
BLOCK = SCRIPTS / "scenes" / "block_on_plate.toml"


@pytest.fixture
def bench(monkeypatch):
    """The script, without a trace of it left behind."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    yield __import__("bench_calculix")
    sys.modules.pop("bench_calculix", None)


@pytest.mark.parametrize("degree", [1, 2])
def test_real_modes_of_the_bodies(bench, tmp_path, degree):
    """With the points by which CalculiX integrates the mass, equal to the digits it prints."""
    table = bench.compare_bodies(BLOCK, [f"mesh.degree={degree}"], 8, tmp_path)
    assert len(table) == 5
    _, here, there = table.T
    assert there == pytest.approx(here, rel=2e-6)


@pytest.mark.slow
def test_flutter_of_a_block(bench, tmp_path):
    """A block that tips under friction, a fifth of it open: frequencies to 0.2 %, growth to 3 %."""
    own = ['contact.block_plate.discretisation="quadrature"', "stability.band=['0 Hz','16 kHz']"]
    table = bench.compare(BLOCK, own, 2e13, 1e-4, 10, tmp_path)
    assert len(table) == 6
    here, there, grows, growth = table.T
    assert abs(there / here - 1).max() < 2e-3
    assert (grows > 1.0).sum() == 1
    assert growth[grows > 1.0] == pytest.approx(grows[grows > 1.0], rel=0.03)
    assert growth[grows <= 1.0] == pytest.approx(0.0, abs=1.0)
