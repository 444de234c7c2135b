"""A study of random materials with damping: its reduced model, cache and processes."""

import json

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from coarse_block import BLOCK

SELF = MPI.COMM_SELF
GIVEN = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "contact.block_plate.friction={ static=0.6, kinetic=0.4, decay='2 m/s' }",
    "parts.block.size='20 mm'", "parts.plate.size='30 mm'", "stability.band=['0 Hz','15 kHz']",
    "stability.verify=0", "stability.zeta_max=0.3", "samples.n=2",
    "samples.random.\"materials.lining.C44\"={ law='uniform', spread=0.2 }",
]  # fmt: skip
TERMS = {
    "bodies": "rayleigh=['20 1/s','1e-8 s'], loss=true, omega_ref='8 kHz'",
    "contact": "sliding=true, slope=true",
}
LOSSES = ["materials.lining.loss=0.02", "materials.iron.loss=0.001"]


def stored(folder, approach="multi-scale"):
    files = sorted((folder / "samples").glob(f"{approach}-*.npz"))
    return [dict(np.load(file)) for file in files]


@pytest.mark.long
@pytest.mark.parametrize("terms", TERMS)
def test_samples_are_those_of_full_order(terms, comm, tmp_path):
    """Every mode within its error; nothing is said to be solved at full order."""
    folder = comm.bcast(tmp_path if comm.rank == 0 else None, root=0)
    damping = f"stability.damping={{ {TERMS[terms]} }}"
    losses = LOSSES if terms == "bodies" else []
    for method in ("reduced", "full"):
        run(BLOCK, comm, folder / method, [*GIVEN, *losses, damping, f"stability.method={method}"])
    summary = json.loads((folder / "reduced" / "summary.json").read_text())
    assert summary["damped_model"]["complete_up_to_hz"] > 15e3
    assert not (folder / "reduced" / "cache" / "undamped.npz").exists()
    assert "full order" not in (folder / "reduced" / "log.txt").read_text()
    both = zip(stored(folder / "reduced"), stored(folder / "full"), strict=True)
    for found, exact in both:
        assert found["s"].size == exact["s"].size >= 5
        assert "zeros of T(z)" in str(found["counted"])
        distance = np.abs(found["s"] - exact["s"])
        # The equilibria differ by the interpolation of the compliance.
        assert np.all(distance <= found["error"] + exact["error"] + 1e-6 * np.abs(exact["s"]))
        np.testing.assert_allclose(found["shares"], exact["shares"], atol=0.01)
        wrong = {str(v) for v in found["verdict"][found["verdict"] != exact["verdict"]]}
        assert wrong <= {"neutral"}


@pytest.mark.long
@pytest.mark.parametrize("rough", ["joint", "multi-scale"])
def test_undamped_samples_beside_damped_ones(rough, tmp_path):
    """Falling friction is none of parametric: one set of bodies serves joint too.

    Beside multi-scale, which has the scene's own bodies, parametric took these for damped.
    """
    both = [f"samples.approaches=['{rough}','parametric']"]
    both += [f"samples.{name}={{ n=2, design='random' }}" for name in ("joint", "parametric")]
    changes = [*GIVEN, "stability.damping.slope=true", "stability.method=reduced", *both,
               "samples.classical.friction=0.5"]  # fmt: skip
    run(BLOCK, SELF, tmp_path, changes)
    damped, free = stored(tmp_path, rough)[0], stored(tmp_path, "parametric")[0]
    assert "zeros of T(z)" in str(damped["counted"]) and "zeros of T(z)" in str(free["counted"])
    pairs = free["s"][np.abs(free["s"].real) > 1.0]
    assert np.all([np.abs(free["s"] + s.conjugate()).min() < 1e-6 * abs(s) for s in pairs])
