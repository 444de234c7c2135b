#!/usr/bin/env python3
"""What the laws do to the squeal of a brake: one table, and the squeal maps side by side.

    scripts/laws_study.py [SCENE] [-o DIR] [--samples 20] [--figure FILE] [--set KEY=VALUE]

Rows are the same brake with other laws, each in a folder of its own below DIR; finished ones are
only read. Columns: share of open contact elements, median stiffness of the closed ones in loading
and for small vibrations, unstable modes and squeal modes of a sample with the standard error of
their mean, and seconds of the laws and of the whole run.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from bench_ensemble import SCENE, study

from brake_fenicsx.report.style import (
    BLUE,
    DAMPING_LABEL,
    GREY,
    KHZ,
    VERMILION,
    damping_axis,
    house_style,
    new_figure,
    save,
)
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.squeal import squeals

SOURCE = [
    "surface.low=extend", "surface.S_q=scan", "surface.distribution=johnson",
    "surface.spectrum=fit", "micro.pixels=128", "micro.max_pressure=0.1",
]  # fmt: skip
CASES = {
    "source: spectrum lowered, 128 pixels, elastic": [*SOURCE, "contact.pad_disc.gap=hdf"],
    "measured spectrum, pixels of the scan, elastic": [
        "micro.max_pressure=0.1", "contact.pad_disc.gap=hdf",
    ],
    "the same, hardness 200 MPa": ["micro.hardness=200 MPa", "contact.pad_disc.gap=hdf"],
    "the same, waviness as critical gaps": [
        "micro.hardness=200 MPa", "contact.pad_disc.gap=waviness",
    ],
}  # fmt: skip


def row(name: str, run: RunData, seconds: dict[str, float]) -> None:
    """One line of the table."""
    assert run.contact is not None
    own = run.contact["law"] >= 0
    p, k, v = (run.contact[n][own] for n in ("p", "k", "k_vibration"))
    closed = p > 0
    modes = run.squeal.modes("multi-scale")
    squeal = squeals(modes, run.threshold)
    samples = np.unique(modes["sample"])
    counts = [
        np.array([np.count_nonzero(modes["sample"][chosen] == s) for s in samples])
        for chosen in (modes["verdict"] == "unstable", squeal)
    ]
    said = " | ".join(f"{c.mean():.2f} ± {c.std() / np.sqrt(c.size):.2f}" for c in counts)
    print(
        f"| {name} | {100 * np.mean(~closed):.0f} % | {np.median(k[closed]) / 1e10:.2f}"
        f" | {np.median(v[closed]) / 1e10:.2f} | {said} | {seconds.get('micro', 0):.0f}"
        f" | {sum(seconds.values()):.0f} |",
        flush=True,
    )


def draw(runs: dict[str, RunData], file: Path) -> None:
    """Frequency against damping of the rough samples, a panel for each kind of law."""
    with house_style():
        figure, axes = new_figure(len(runs), 1, height=1.8 * len(runs), sharex=True, sharey=True)
        for axis, (name, run) in zip(axes[:, 0], runs.items(), strict=True):
            modes = run.squeal.modes("multi-scale")
            squeal = squeals(modes, run.threshold)
            unstable = (modes["verdict"] == "unstable") & ~squeal
            rest = ~squeal & ~unstable
            for chosen, colour, size, text in (
                (rest, BLUE, 6, "stable or neutral"), (unstable, GREY, 12, "unstable, no squeal"),
                (squeal, VERMILION, 14, "squeal"),
            ):  # fmt: skip
                axis.scatter(
                    modes["frequency_hz"][chosen] / 1e3, modes["damping"][chosen], s=size, lw=0,
                    color=colour, label=f"{text}: {chosen.sum()}", rasterized=True,
                )  # fmt: skip
            damping_axis(axis)
            axis.set_yticks([-0.1, -0.01, -0.001, 0.0, 0.001, 0.01])
            axis.grid(axis="y", color="0.9", linewidth=0.6)
            axis.set_title(name, loc="left", fontsize=9)
            axis.legend(loc="lower right", ncol=3, fontsize=7.5, handletextpad=0.1)
            axis.set_ylabel(DAMPING_LABEL, fontsize=8)
        axes[-1, 0].set_xlabel(KHZ)
        save(figure, file.parent, file.stem)


def main() -> None:
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("scene", nargs="?", default=SCENE, type=Path)
    words.add_argument("-o", dest="folder", default="laws-study", type=Path)
    words.add_argument("--samples", default=20, type=int)
    words.add_argument("--processes", default=1, type=int)
    words.add_argument("--figure", default="laws-study/squeal_maps.png", type=Path)
    words.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    asked = words.parse_args()
    print("| laws | open | k [1e10 Pa/m] | of vibrations | unstable | squeal | laws [s]", end="")
    print(" | all [s] |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    asked.folder.mkdir(parents=True, exist_ok=True)
    elastic = asked.folder / "elastic.toml"  # a change can set a key, not take it out
    lines = asked.scene.read_text().splitlines(keepends=True)
    elastic.write_text("".join(x for x in lines if not x.startswith("hardness")))
    scan = asked.scene.resolve().parent / "pad_scan.npz"
    runs = {}
    common = [
        f"surface.scan={scan}", "samples.approaches=['multi-scale']", "stability.verify=0",
        "stages=['surface', 'micro', 'equilibrium', 'stability', 'uncertainty']", *asked.changes,
    ]  # fmt: skip
    for number, (name, changes) in enumerate(CASES.items()):
        out = asked.folder / str(number)
        if not (out / "modes.csv").exists():
            study(elastic, out, asked.samples, asked.processes, [*common, *changes])
        runs[name] = read_run(out)
        summary = runs[name].summary or {}
        row(name, runs[name], summary.get("seconds", {}))
    draw(runs, asked.figure)


if __name__ == "__main__":
    main()
