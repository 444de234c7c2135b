#!/usr/bin/env python3
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Figures 5 to 9 of the source, from one scene
#
# F. Maaboudallah and N. Atalla, "A Multi-Scale Investigation to Predict the Dynamic Instabilities
# Induced by Frictional Contact", Lubricants 11 (2023) 344, doi:10.3390/lubricants11080344.
#
# Runs as a script or, opened with jupytext, as a notebook:
#
#     scripts/paper_figures.py [SCENE.toml] [-o FOLDER] [--set KEY=VALUE ...]
#
# Without a scene it takes the reference brake on a coarse mesh with few samples (a few minutes);
# `scripts/scenes/disc_brake.toml` has the sizes of the source (300 samples, about 20 minutes). The
# scan is not the authors': it is an artificial one with the statistics that they print.

# +
import argparse
from pathlib import Path

from mpi4py import MPI

import numpy as np

from brake_fenicsx.build.law_stage import law_recipe
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.micro import load_laws
from brake_fenicsx.pipeline import run
from brake_fenicsx.report.contact_figures import draw_contact_maps, draw_laws
from brake_fenicsx.report.figure_inputs import contact_maps
from brake_fenicsx.report.squeal_figures import draw_squeal_map
from brake_fenicsx.report.style import house_style, save
from brake_fenicsx.report.surface_figures import draw_artificial, draw_statistics
from brake_fenicsx.results.answer import summary_table
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene

HERE = Path(globals().get("__file__", "scripts/paper_figures.py")).resolve().parent
words = argparse.ArgumentParser(description="Figures 5 to 9 of the source, from one scene.")
words.add_argument("scene", nargs="?", default=HERE / "scenes" / "disc_brake_demo.toml")
words.add_argument("-o", dest="folder", default="paper-results", type=Path)
words.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
asked, _ = words.parse_known_args()
comm = MPI.COMM_WORLD
# -

# ## The three systems
#
# (a) the multi-scale approach: every contact patch has its own pressure-gap law and critical gap;
# (b) FAST: perfect contact, the friction coefficient drawn from N(0.5, 0.05) cut to [0.3, 0.7];
# (c) the classical approach: perfect contact, mu = 0.5.
#
# The source also varies the pad's moduli in (b). To have that, add
# `--set 'samples.random."materials.lining.E_3"={ law = "uniform", spread = 0.2 }'`, likewise G_13
# and G_23; it takes longer, since the brake's own basis does not serve other moduli.

# +
FRICTION = "{ law = 'normal', mean = 0.5, sd = 0.05, min = 0.3, max = 0.7 }"
contacts = read_scene(asked.scene, asked.changes).contact
SYSTEMS = [
    "stages=['surface','micro','equilibrium','stability','uncertainty']",
    "samples.approaches=['multi-scale','parametric','classical']",
    *(f"samples.random.'contact.{name}.friction'={FRICTION}" for name in contacts),
]
result = run(asked.scene, comm, asked.folder, [*SYSTEMS, *asked.changes])
# -

# Everything below is drawn from the folder of that run, on one process.

# +
leads = comm.rank == 0
if leads:
    contact_maps(asked.folder)
    data = read_run(asked.folder)
figures = asked.folder / "figures"


def show(name, draw):
    """Draw a figure, keep it as PNG and SVG, and give it to the notebook."""
    if not leads:
        return None
    figures.mkdir(exist_ok=True)
    with house_style():
        figure = draw(data)
        save(figure, figures, name)
    return figure


# -

# ## Figure 5: height distribution and power spectrum
#
# The radial power spectrum C(q) is fitted by the bi-fractal law of Eq. (17),
# C = C_0 q^c1 below the crossover q_c and C_1 q^c2 above, continuous there.

# +
stats = read_surface(result.scene)
PRINTED = {"S_q": 33.1e-6, "S_sk": -0.2410, "S_ku": 3.6549, "c1": -2.0, "c2": -4.5}
found = {name: getattr(stats, name) for name in ("S_q", "S_sk", "S_ku")}
found |= {name: getattr(stats.bifractal, name) for name in ("c1", "c2")}
if leads:
    print(f"{'':6}{'here':>10}{'printed':>10}")
    for name, printed in PRINTED.items():
        scale = 1e6 if name == "S_q" else 1.0
        print(f"{name:6}{scale * found[name]:10.4g}{scale * printed:10.4g}")
show("figure5_statistics", draw_statistics)
# -

# ## Figure 6: an artificial surface
#
# Drawn from the heights' distribution and the fitted spectrum; the patch is longer than the scan.

# +
made = law_recipe(result.scene, stats).surface(0, 0)
if leads:
    print(f"artificial surface: S_q {1e6 * made.heights.std():.2f} um, asked {1e6 * stats.S_q:.2f}")
show("figure6_artificial", draw_artificial)
# -

# ## Figure 7: the real contact
#
# The surface of the first law, pressed by a rigid plane: min 1/2 p'Hp - p'u with p >= 0.

show("figure7_contact_maps", draw_contact_maps)

# ## Figure 8: the library of pressure-gap laws
#
# One law for each artificial surface. Any of them can be made again alone, from its number.

# +
laws = load_laws(asked.folder / "laws.npz")
law = law_recipe(result.scene, stats).law(result.scene.micro.seed, 0)
p, d, k = law.p / 1e6, 1e6 * law.d, law.k / 1e9
if leads:
    print(f"law 0: {p[0]:.3g} MPa at {d[0]:.1f} um, {p[-1]:.3g} MPa", end="")
    print(f" at {d[-1]:.1f} um, stiffness {k[0]:.3g} to {k[-1]:.3g} N/mm^3")
known = laws.p[0][: law.p.size]  # to where the brake needs it
np.testing.assert_allclose(known, law.p[: known.size], rtol=1e-12)
show("figure8_laws", draw_laws)
# -

# ## Figure 9: the squeal map
#
# Damping is -2 alpha / |omega|, negative where a mode grows. The source leaves the factor open in
# "the ratio between the real and the imaginary part".

# +
if leads:
    print(summary_table(data))
show("figure9_squeal_map", draw_squeal_map)
