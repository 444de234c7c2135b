"""scripts/paper_figures.py on a coarse brake: the reader's way through the source's figures."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from brake_fenicsx.report.style import label
from brake_fenicsx.results.run import read_run

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[2] / "scripts" / "paper_figures.py"
COARSE = [
    "parts.disc.size=30 mm",
    "parts.pad.size=16 mm",
    "parts.pad.plate_size=20 mm",
    "micro.pixels=64",
    "micro.laws=4",
    "samples.n=3",
    "stability.band=['0 Hz', '9 kHz']",
    "stability.verify=0",
]
NAMES = (
    "figure5_statistics", "figure6_artificial", "figure7_contact_maps", "figure8_laws",
    "figure9_squeal_map",
)  # fmt: skip


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    words = [word for change in COARSE for word in ("--set", change)]
    ran = subprocess.run(
        [sys.executable, str(SCRIPT), "-o", str(folder / "out"), *words],
        capture_output=True, text=True, cwd=folder, env=os.environ,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr[-2000:]
    return folder / "out", ran.stdout


def test_every_figure_is_there_as_png_and_svg(done):
    folder, _ = done
    for name in NAMES:
        assert (folder / "figures" / f"{name}.png").stat().st_size > 20_000
        assert (folder / "figures" / f"{name}.svg").stat().st_size > 20_000


def test_figure_9_holds_the_three_systems(done):
    folder, _ = done
    run = read_run(folder)
    assert run.approaches == ["classical", "parametric", "multi-scale"]
    text = (folder / "figures" / "figure9_squeal_map.svg").read_text()
    assert all(f"{label(run, name)}:" in text for name in run.approaches)


def test_the_scan_has_the_printed_statistics(done):
    """Left: measured here, right: printed in the source; the slopes within their scatter."""
    rows = {
        name: (float(here), float(printed))
        for name, here, printed in re.findall(r"^(\w+) +(-?[\d.]+) +(-?[\d.]+)$", done[1], re.M)
    }
    assert set(rows) == {"S_q", "S_sk", "S_ku", "c1", "c2"}
    for name, within in (("S_q", 0.5), ("S_sk", 0.05), ("S_ku", 0.1), ("c1", 0.4), ("c2", 0.3)):
        here, printed = rows[name]
        assert abs(here - printed) < within, name
