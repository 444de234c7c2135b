"""Samples of the reduced model on two blocks: constant or changing materials, damped or not."""

from functools import cache

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.stability import (
    ContactLinearisation,
    Parameters,
    reduce_bodies,
    split_substructures,
)
from brake_fenicsx.stability.damping_matrices import friction_damping, gyroscopic
from brake_fenicsx.stability.substructures import CONSTANT
from dense_reference import Dense, agrees, all_lambda

BAND, K0, SPEED, ZETA = (0.0, 60e3), 3e11, 2.0, 0.3
HIGH = 2 * np.pi * BAND[1]
OMEGA_REF = 2 * np.pi * 30e3

# C33 and C44 = C55 of the lining [Pa], whose inverses change by SPREAD at the ends of the box.
MODULI, SPREAD = np.array([2.27e9, 1.18e9]), 0.2

# Loss factors at 30 kHz of lining and plate, and of what C44 = C55 alone adds to the lining's;
# alpha, beta of Rayleigh; speed of the turning plate; rates at contact.
CASES = {
    "undamped": {},
    "sliding": dict(across=True),
    "falling": dict(along=True),
    "rayleigh": dict(alpha=500.0, beta=2e-8),
    "loss": dict(loss=(0.1, 0.002, 0.0)),
    "contrast": dict(loss=(1e-4, 0.1, 0.0)),
    "layers": dict(loss=(0.04, 0.002, 0.08)),
    "turning": dict(turn=800.0),
    "dashpot": dict(loss=(0.01, 0.002, 4.0)),
    "little": dict(loss=(2e-4, 2e-4, 0.0)),
    "all": dict(
        loss=(0.04, 0.002, 0.05), alpha=500.0, beta=1e-8, turn=800.0, across=True, along=True
    ),
}


def coefficients(spread=SPREAD):
    """Of both unit changes, linear in the compliances: a uniform change is captured at once."""
    return lambda x: MODULI * (1 / (1 + spread * np.asarray(x)) - 1)


@cache
def unit_changes(scene):
    """Stiffness of a unit of C33, and of C44 = C55, of the lining."""
    changes = [{"pad.body": np.diag(np.isin(np.arange(6), p) + 0.0)} for p in (2, [3, 4])]
    parts = affine_parts(scene.mesh, scene.free, changes)
    return parts


@cache
def damping(scene, case):
    """Damping of the bodies, None without, and the share of each unit change that it takes."""
    terms = CASES[case]
    alpha, beta = terms.get("alpha", 0.0), terms.get("beta", 0.0)
    pad, plate, shear = (eta / OMEGA_REF for eta in terms.get("loss", (0.0, 0.0, 0.0)))
    layers = [
        affine_parts(scene.mesh, scene.free, [{n: scene.materials[n].C}])[0]
        for n in ("pad.body", "plate.body")
    ]
    C = alpha * scene.M + beta * scene.K + pad * layers[0] + plate * layers[1]
    C = C + shear * MODULI[1] * unit_changes(scene)[1]
    if terms.get("turn"):
        G = gyroscopic(scene.mesh, scene.free, {"plate.body": 7200.0}, Rotation(terms["turn"]))
        C = C + G
    C = C.tocsr()
    C.eliminate_zeros()
    return (C if C.nnz else None), np.array([pad + beta, pad + shear + beta])


def substructures(scene, case, changing, points=None):
    """The blocks apart."""
    C, _ = damping(scene, case)
    changes = unit_changes(scene) if changing else []
    interface = {"N": scene.N, "T": scene.T, "R": scene.R}
    return split_substructures(scene.K, scene.M, interface, scene.f[:, None], changes, C, points)


def box(scene, case, spread=SPREAD):
    """The box of both moduli, damping following the stiffness."""
    shares = damping(scene, case)[1]

    def both(x):
        a = coefficients(spread)(x)
        return np.array([a, a * shares, 0 * a])

    return Parameters(2, both, 1 / (1 + spread))


def followed(case):
    """Motions that contact forces follow."""
    return "N" + "T" * CASES[case].get("along", False) + "R" * CASES[case].get("across", False)


@cache
def offline(scene, case="undamped", changing=False, spread=SPREAD, tolerance=1e-5, comm=None):
    """The reduced model, made once."""
    parameters = box(scene, case, spread) if changing else CONSTANT
    bodies = substructures(scene, case, changing)
    return reduce_bodies(
        bodies, scene.w, BAND, parameters, followed(case), tolerance, comm=comm or scene.comm
    )


def scattered(scene, seed, decades=1.0, shut=0.3):
    """Stiffness over some decades to either side of K0, three in ten elements open."""
    rng = np.random.default_rng(seed)
    k = K0 * 10 ** rng.uniform(-decades, decades, scene.w.size)
    k[rng.random(scene.w.size) < shut] = 0.0
    return k


class Sample:
    """Contact stiffness with pressures, at a point x of the box, and the same at full order."""

    def __init__(self, scene, case="undamped", x=(), mu=0.5, seed=1, k=None, spread=SPREAD):
        self.scene, self.case, self.x, self.mu = scene, case, np.array(x, float), mu
        self.k = scattered(scene, seed) if k is None else k
        terms, rng = CASES[case], np.random.default_rng(seed)
        p = np.where(self.k > 0, 5e5 * rng.uniform(0, 2, self.k.size), 0.0)
        self.along = -0.1 * p * terms.get("along", False)
        self.across = mu * p / SPEED * terms.get("across", False)
        C, shares = damping(scene, case)
        C = sp.csr_matrix(scene.K.shape) if C is None else C
        self.K, self.M = scene.tangent(self.k, mu), scene.M
        if self.x.size:
            c = coefficients(spread)(self.x)
            for a, share, A in zip(c, shares, unit_changes(scene), strict=True):
                self.K, C = self.K + a * A, C + share * a * A
        rates = self.along, self.across
        self.C = (C + friction_damping(scene.T, scene.R, scene.w, *rates)).tocsr()

    @property
    def contact(self):
        return ContactLinearisation.of(self.k, self.mu, self.along, self.across)

    def modes(self, model, growing=False):
        return model.modes(self.x, self.contact, ZETA, growing)

    def agrees(self, modes):
        """None missed or doubled, errors covered, no wrong verdict; the largest relative error."""
        if self.case == "undamped":
            return agrees(modes, all_lambda(self.K, self.M), BAND)[0]
        return Dense(self.M, self.C, self.K, HIGH, ZETA).agrees(modes)
