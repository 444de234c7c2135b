#!/usr/bin/env python3
"""Where the iterations of the reduced model and of the equilibrium stand still: their noise floors.

Every iteration is asked for more than the arithmetic has, and states what is left. The table of the
developer guide is made of this; `--all` adds the reference brake to the demo.

    scripts/noise_floors.py [--all] [SEED ...]      random scenes of tests/random_scenes.py
"""

import sys
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np

from brake_fenicsx import prepare
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.macro.equilibrium import equilibrium
from brake_fenicsx.samples.solve import linearised, reduced_modes
from brake_fenicsx.stability.substructures import vectors

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scripts" / "scenes"
sys.path.insert(0, str(ROOT / "tests"))
HEADS = ("scene", "elements", "modes", "equilibrium", "motions", "vectors", "displacements")
BELOW = 1e-300


def floors(study) -> list[str]:
    """Elements, modes and the largest of what each iteration leaves, of the first sample."""
    task = study.tasks[0]
    models, sample = study.models, study.sample(task)
    reduced = models.reduction.takes(sample)
    bodies = study.equilibria.bodies(sample, reduced)
    eq = equilibrium(bodies, sample.laws, sample.friction.equilibrium, 2, tolerance=BELOW)
    modes = reduced_modes(models, sample, eq)
    model, p = models.reduction.of(sample.approach), sample.brake.point
    contact = linearised(sample, eq.k_vibration, eq.p)
    chosen = np.flatnonzero(modes.s.imag > 0.01 * 2 * np.pi * model.band[1])[:40]
    s, right, left = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
    with mock.patch.object(vectors, "SETTLED", BELOW):
        first, z = model.sample(p, contact), model.scaled(s)
        motions = [
            vectors.right_motions(first, z, right)[1],
            vectors.left_motions(first, z, left.conj())[1],
        ]
        sharp, a, _ = model.motions(p, contact, s, right, left)
        shapes = model.displacements(p, contact, s, a)[1]
    sizes = eq.residual, np.max(motions), np.max(sharp.error), np.max(shapes)
    return [str(eq.g.size), str(chosen.size), *(f"{size:.0e}" for size in sizes)]


def main(words: list[str]) -> None:
    """Print the table."""
    from random_scenes import random_scene, with_band

    def of_seed(seed):
        return prepare(with_band(random_scene(seed), seed))

    one = ["samples.n=1", "micro.laws=2", "stability.verify=0"]
    given = {"demo": lambda: prepare(SCENES / "disc_brake_demo.toml", one)}
    if "--all" in words:
        given["reference brake"] = lambda: prepare(SCENES / "disc_brake.toml", one)
    for word in words:
        if word.isdigit():
            given[f"random {word}"] = partial(of_seed, int(word))
    print("| " + " | ".join(HEADS) + " |\n|" + " --- |" * len(HEADS))
    for name, make in given.items():
        try:
            row = floors(make().study)
        except BrakeError as error:
            row = [str(error)]
        print("| " + " | ".join([name, *row]) + " |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
