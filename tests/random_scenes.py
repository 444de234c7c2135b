"""Scenes drawn at random from all keys that add to matrices, and their samples beside LAPACK.

A block on a sliding plate of 150 to 800 unknowns. Moduli, densities, masses, springs, dashpots, the
law of the contact, friction, damping and random inputs are drawn from ranges wider than those of
brakes; the band ends at the 8th to 40th mode.
"""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.linalg as la

from brake_fenicsx import prepare
from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.pipeline import assemble
from brake_fenicsx.samples.solve import linearised
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.substructures.reduced_model import LISTED
from dense_reference import all_damped, all_lambda

DAMPING = ("none", "rayleigh", "loss", "sliding", "slope", "mixed")
MOST = 1200  # unknowns, of which LAPACK has all eigenvalues within a minute
LINING = {"C11": 5.94e9, "C12": 0.76e9, "C13": 0.98e9, "C33": 2.27e9, "C44": 1.18e9}


def log_uniform(rng, low, high):
    """One number between two, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_scene(seed):
    """A scene as a mapping; its band is still to be chosen."""
    rng = np.random.default_rng(seed)
    length, height = rng.uniform(30, 60), rng.uniform(8, 30)
    thick = rng.uniform(6, 14)
    lining = log_uniform(rng, 1e-3, 4.0)
    parts = {
        "block": {
            "builder": "block", "length": f"{length:.6g} mm", "material": "lining",
            "width": f"{rng.uniform(10, 26):.6g} mm", "height": f"{height:.6g} mm",
            "size": f"{rng.uniform(9, 14):.6g} mm",
        },
        "plate": {
            "builder": "block", "length": f"{length + 20:.6g} mm", "material": "iron",
            "width": f"{rng.uniform(28, 38):.6g} mm", "height": f"{thick:.6g} mm",
            "z": f"{-thick:.6g} mm", "size": f"{rng.uniform(12, 16):.6g} mm",
        },
    }  # fmt: skip
    materials = {
        "iron": {
            "model": "isotropic", "E": f"{log_uniform(rng, 2e9, 2e11):.6g} Pa", "nu": 0.24,
            "rho": f"{log_uniform(rng, 700, 7e4):.6g} kg/m^3",
        },
        "lining": {
            "model": "transversely-isotropic", "rho": f"{log_uniform(rng, 800, 2e4):.6g} kg/m^3",
            **{name: f"{lining * C:.6g} Pa" for name, C in LINING.items()},
        },
    }  # fmt: skip
    mu, speed = float(rng.uniform(0.0, 0.9)), log_uniform(rng, 0.02, 10.0)
    law = (
        {"linear": f"{log_uniform(rng, 1e10, 1e15):.6g} Pa/m"}
        if rng.random() < 0.5
        else {"p0": "10 MPa", "u0": f"{log_uniform(rng, 1e-8, 1e-5):.6g} m"}
    )
    kind = DAMPING[seed % len(DAMPING)]
    friction = mu
    if kind in ("slope", "mixed"):
        friction = {
            "static": mu, "kinetic": mu * float(rng.uniform(0.4, 1.0)),
            "decay": f"{log_uniform(rng, 0.05, 5.0):.6g} m/s",
        }  # fmt: skip
    damping = {}
    if kind in ("rayleigh", "mixed"):
        damping["rayleigh"] = [
            f"{log_uniform(rng, 1, 300):.6g} 1/s", f"{log_uniform(rng, 1e-9, 1e-7):.6g} s",
        ]  # fmt: skip
    if kind in ("loss", "mixed"):
        damping["loss"] = True
        damping["omega_ref"] = f"{log_uniform(rng, 500, 2e4):.6g} Hz"
        materials["iron"]["loss"] = log_uniform(rng, 1e-3, 0.03)
        materials["lining"]["loss"] = log_uniform(rng, 1e-3, 0.2)
    damping |= {name: True for name in ("sliding", "slope") if kind in (name, "mixed")}
    scene = {
        "stages": ["equilibrium", "stability", "uncertainty"],
        "parts": parts, "materials": materials,
        "supports": {"plate.bottom": "clamped", "block.top": ["x", "y"]},
        "loads": {"block.top": {"pressure": f"{log_uniform(rng, 3e4, 3e6):.6g} Pa", "steps": 2}},
        "motion": {"direction": [1, 0, 0], "speed": f"{speed:.6g} m/s"},
        "contact": {
            "c": {"faces": ["block.bottom", "plate.top"], "law": law, "friction": friction}
        },
        "mesh": {"degree": 1 if rng.random() < 0.8 else 2},
        "stability": {"method": "reduced", "zeta_max": 0.3},
        "samples": {"n": 2, "seed": seed},
    }  # fmt: skip
    if damping:
        scene["stability"]["damping"] = damping
    random = {
        "contact.c.friction": 0.2,
        "materials.iron.E": 0.2,
        "materials.lining.C33": 0.15,
        "parts.block.height": 0.03,
    }
    names = [name for name in random if name[0] != "c" and rng.random() < 0.35]
    scene["samples"]["random"] = {
        name: {"law": "uniform", "spread": random[name]}
        for name in (*names, *(["contact.c.friction"] if kind == "none" and mu > 0 else []))
    }
    if rng.random() < 0.4:
        scene["masses"] = {"block.top": {"mass": f"{log_uniform(rng, 1e-3, 20):.6g} kg"}}
    if "parts.block.height" not in names and rng.random() < 0.4:
        stiffness, dashpot = log_uniform(rng, 1e4, 1e8), log_uniform(rng, 0.1, 30.0)
        scene["springs"] = {
            "block.sides": {
                "stiffness": [f"{stiffness:.6g} N/m"] * 3,
                **({"damping": [f"{dashpot:.6g} N s/m"] * 3} if kind == "mixed" else {}),
            }
        }
    return scene


def with_band(scene, seed):
    """The scene with a band up to a mode of its bodies on springs that the contact may be."""
    rng = np.random.default_rng([seed, 1])
    narrow = {**scene["stability"], "band": ["0 Hz", "1 kHz"]}
    brake = assemble(scene | {"stability": narrow}, MPI.COMM_SELF)
    if brake.K.shape[0] > MOST:
        scene = scene | {"mesh": {"degree": 1}}
        brake = assemble(scene | {"stability": narrow}, MPI.COMM_SELF)
    stiffness = brake.N.T @ (brake.N.multiply(1e10 * brake.w[:, None]))
    kappa = la.eigvalsh((brake.K + stiffness).toarray(), brake.M.toarray())
    f = np.sqrt(np.abs(kappa)) / (2 * np.pi)
    top = min(1.03 * f[rng.integers(8, min(40, f.size - 1))], 20e3)
    return scene | {"stability": {**scene["stability"], "band": ["0 Hz", f"{top:.8g} Hz"]}}


@dataclass(frozen=True)
class Compared:
    """A sample of the reduced model beside LAPACK.

    Attributes:
        modes: number of modes of the reduced model.
        ratio: largest true error over stated error.
        missed: eigenvalues of LAPACK in the stated region that the reduced model has not.
        wrong: verdicts stable for unstable or the reverse.
        undefined: stated errors that are no number or infinite.
        left: largest error that the vectors state, of modes whose own is within the tolerance.
        quotient: largest error of the two-sided quotient of the displacements, over the stated one.
        alone: as ``ratio``, of the growing modes of a solution for these alone.
    """

    modes: int
    ratio: float
    missed: int
    wrong: int
    undefined: int
    left: float
    quotient: float
    alone: float


def compared(study, task):
    """One sample beside LAPACK on the same matrices; None where it has no equilibrium."""
    models = study.models
    sample = study.sample(task)
    try:
        eq, modes = study.solved(task, {})
    except (NotConverged, InaccurateResult):
        return None
    b = sample.brake.contact
    K = tangent(sample.brake.K, b.N, b.T, b.w, eq.k_vibration, sample.friction.mu).toarray()
    M, C = sample.brake.M.toarray(), sample.brake.C(sample.friction, eq.p)
    low, high = (2 * np.pi * f for f in models.stability.band)
    model = models.reduction.of(sample.approach)
    if C is None:
        exact = all_lambda(K, M)
        exact = np.concatenate([exact, -exact.conj()[np.abs(exact.real) > 1e-9 * np.abs(exact)]])
        zeta = np.inf
    else:
        exact, zeta = all_damped(M, C.toarray(), K, high), models.stability.zeta_max
    # What LAPACK leaves of a stiff contact: round-off of the largest eigenvalue.
    floor = 1e-14 * np.abs(exact).max() * np.abs(exact).max() / np.abs(exact)
    inside = (exact.imag > low) & (exact.imag <= high) & (np.abs(exact) <= LISTED * high)
    inside &= exact.real >= -zeta * np.abs(exact) if np.isfinite(zeta) else True
    # Next to the ends of the region either answer is right.
    edge = 1e-4
    inside &= (exact.imag < (1 - edge) * high) & (np.abs(exact) < (1 - edge) * LISTED * high)
    if np.isfinite(zeta):
        inside &= exact.real > -(1 - edge) * zeta * np.abs(exact)
    inside &= exact.imag > 1e-3 * high
    elastic = modes.s.imag > 1e-3 * high
    s, error = modes.s[elastic], modes.error[elastic]
    distance = np.abs(s[:, None] - exact)
    nearest = distance.argmin(axis=1) if s.size else np.zeros(0, int)
    allowed = error + floor[nearest]
    true = exact[nearest]
    reached = np.any(distance <= allowed[:, None], axis=0)
    missed = int(np.sum(inside & ~reached))
    verdict = np.array(modes.verdict, str)[elastic]
    grows = true.real > 1e-6 * np.abs(true)
    wrong = np.sum((verdict == "stable") & grows & (true.real > floor[nearest]))
    wrong += np.sum((verdict == "unstable") & ~grows & (true.real < -floor[nearest]))
    contact = linearised(sample, eq.k_vibration, eq.p)
    p = sample.brake.point
    given = p, contact, s, modes.right[:, elastic]
    motions, right, left = model.motions(*given, modes.left[:, elastic])
    u, right_error = model.displacements(*given[:-1], right)
    v, left_error = model.displacements(*given[:-1], left, left=True)
    within = error <= models.stability.tolerance * np.abs(s)
    Cu = np.zeros_like(u) if C is None else C @ u
    quotient = np.sum(v.conj() * (M @ u * true**2 + Cu * true + K @ u), axis=0)
    quotient = np.abs(quotient / np.sum(v.conj() * (2 * true * (M @ u) + Cu), axis=0))
    alone = model.modes(p, contact, models.stability.zeta_max, growing=True)
    grown = (alone.s.real > 1e-6 * np.abs(alone.s)) & (alone.s.imag > 1e-3 * high)
    off = np.abs(alone.s[grown, None] - exact)
    off = off.min(axis=1) / (alone.error[grown] + floor[off.argmin(axis=1)])
    return Compared(
        len(modes), float(np.max(distance.min(axis=1) / allowed, initial=0.0)) if s.size else 0.0,
        missed, int(wrong), int(np.sum(~np.isfinite(modes.error))),
        float(np.max(np.array([motions.error, right_error, left_error])[:, within], initial=0.0)),
        float(np.max(quotient / allowed, initial=0.0)), float(off.max(initial=0.0)),
    )  # fmt: skip


def hunted(seed, **stability):
    """Samples of a random scene beside LAPACK; what refused the scene, if anything did."""
    scene = with_band(random_scene(seed), seed)
    scene["stability"] |= stability
    try:
        study = prepare(scene).study
    except (InaccurateResult, SceneError) as error:
        return [], str(error)
    return [found for task in study.tasks if (found := compared(study, task)) is not None], ""
