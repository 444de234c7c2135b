"""Measured resonances of three solids against those that this program computes from their scenes.

    python scripts/measured_solids.py        table on the terminal, docs/measured_solids.png

Scenes and measured frequencies stand in scripts/scenes/measured, the sources in
docs/measured_solids.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx.extras.measured.part_modes import part_modes
from brake_fenicsx.extras.measured.posterior import assigned, read_peaks
from brake_fenicsx.results.tables import text_table
from brake_fenicsx.scene import read_scene

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scripts" / "scenes" / "measured"
# Scene -> part, whether it is supported, widest difference of a pair.
SOLIDS = {
    "aluminium_box": ("box", False, 0.01),
    "srtio3_box": ("box", False, 0.01),
    "fan_blade": ("blade", True, 0.05),
}
TITLES = ("aluminium box", "strontium titanate box", "fan blade, clamped")


def compared(
    name: str, overrides: tuple[str, ...] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured and computed frequencies of a solid [Hz], and the mode of each measured one."""
    part, supported, gate = SOLIDS[name]
    (peaks,) = read_peaks(SCENES / f"{name}.csv")
    scene = read_scene(SCENES / f"{name}.toml", overrides)
    highest = (1 + gate) * peaks.frequency.max()
    computed = part_modes(scene, part, np.zeros((1, 3)), highest, supported).frequency
    return peaks.frequency, computed, assigned(np.log(peaks.frequency), np.log(computed), gate)


def rms(measured: np.ndarray, computed: np.ndarray, mode: np.ndarray) -> tuple[float, float]:
    """Root mean square and largest of measured over computed - 1."""
    off = measured[mode >= 0] / computed[mode[mode >= 0]] - 1
    return float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())


def main(folder: Path = ROOT / "docs") -> None:
    """Compare all, print the table and draw the picture."""
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.0), layout="constrained")
    rows = []
    for axis, title, name in zip(axes, TITLES, SOLIDS, strict=True):
        measured, computed, mode = compared(name)
        off, largest = rms(measured, computed, mode)
        used = mode >= 0
        rows.append([title, len(measured), int(used.sum()), f"{100 * off:.2f} %",
                     f"{100 * largest:.2f} %"])  # fmt: skip
        if name == "fan_blade":
            print(text_table(("measured [Hz]", "computed [Hz]"),
                             [[f"{a:.1f}", f"{computed[j]:.1f}"] for a, j in
                              zip(measured, mode, strict=True)]))  # fmt: skip
        axis.axhline(0.0, color="grey", linewidth=0.7)
        axis.plot(measured[used] / 1e3, 100 * (measured[used] / computed[mode[used]] - 1), "o",
                  markersize=4, color="#0072B2")  # fmt: skip
        axis.set(title=title, xlabel="measured frequency [kHz]")
    axes[0].set_ylabel("measured over computed [%]")
    print(text_table(("solid", "measured", "with a partner", "rms", "largest"), rows))
    figure.savefig(folder / "measured_solids.png", dpi=110)


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("folder", nargs="?", default=ROOT / "docs", type=Path, metavar="FOLDER")
    main(words.parse_args().folder)
