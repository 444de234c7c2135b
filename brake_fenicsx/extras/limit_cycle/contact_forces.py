r"""Contact forces of patches over a period of vibration, exact in opening, yielding and reversal.

A patch carries w (p(g) - p_e) along the gap, p_e its pressure at equilibrium. Where a hardness
limits the pressure, unloading and reloading are elastic: from the smallest gap g_m that the patch
has had, at equilibrium or in the vibration, it goes back along

    p = p_m (1 - s)^n,    s = (g - g_m) v_m / (n p_m),    open for s >= 1,

p_m the pressure of loading to g_m and v_m the stiffness of small vibrations there; n = EXPONENT.
Friction mu(|v|) w p acts against the slip velocity v = (V - v_T, -v_R) of the disc past the pad,
with the rates that the scene's damping terms name. Without them its direction does not change, and
``bodies`` takes it as a part of the normal force.
"""

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.macro.gap import EnrichedGap
from brake_fenicsx.macro.sliding_friction import Coefficient, SlidingFriction, patch_forces, sliding

from .harmonic_balance import Tangent

# Of the elastic branch under a hardness.
EXPONENT = 2.0

# Slip velocity below which the direction of friction is smoothed, over the sliding speed.
SMOOTH = 1e-3


@dataclass(frozen=True, slots=True)
class PeriodForces:
    """Forces of some contact elements over a period; see ``harmonic_balance.Forces``.

    Attributes:
        laws: law and critical gap of each element.
        yields: whether a hardness limits its pressure, shape (elements,).
        w: areas [m^2].
        g: gaps at equilibrium [m].
        friction: of each element.
        followed: motions that forces follow: "N", then "T" and "R" where they follow rates.
        coefficient: friction by the slip speed; None where it does not change.
    """

    laws: EnrichedGap
    yields: Mask
    w: Array
    g: Array
    friction: SlidingFriction
    followed: str = "N"
    coefficient: Coefficient | None = None

    def __call__(self, y: Array, v: Array) -> tuple[Array, Tangent]:
        """Forces beyond those of the equilibrium [N], and their tangent."""
        blocks, c, mu = len(self.followed), self.w.size, self.friction.mu
        y, v = y.reshape(blocks, c, -1), v.reshape(blocks, c, -1)
        p, k, past = self.pressure(self.g[:, None] + y[0])
        p_e = self.pressure(self.g[:, None])[0]
        traction, slopes = sliding(mu[:, None], p), None
        rates = ["TR".index(name) for name in self.followed[1:]]
        if rates:
            slip = np.zeros((2, *p.shape))
            slip[rates] = v[1:]
            traction, slopes = self.friction.traction(slip, self.coefficient, SMOOTH)
        acting = 1 + max((1, *(1 + rate for rate in rates))) if rates else 1
        moving = patch_forces(self.w, p, k, traction, slopes)
        still = patch_forces(self.w, p_e, 0 * p_e, sliding(mu[:, None], p_e))
        to_y, to_v = np.zeros((2, acting, blocks, *p.shape))
        to_y[:, 0], to_v[:, 1:] = moving.gap[:acting], moving.rate[:acting, rates]
        to_past = patch_forces(self.w, past, 0 * past, traction).value[:acting]
        tangent = Tangent(
            to_y, to_v if rates else None, to_past if past.any() else None,
            np.argmin(y[0], axis=1),
        )  # fmt: skip
        forces = (moving.value - still.value)[:acting]
        return forces.reshape(-1, y.shape[2]), tangent

    def pressure(self, g: Array) -> tuple[Array, Array, Array]:
        """Pressure p, -dp/dg and, where yielding goes on, dp/dg_m, shape (elements, times).

        Args:
            g: gaps over a period [m], shape (elements, times).
        """
        p, k, past = np.zeros((3, *g.shape))
        soft = self.yields
        if (~soft).any():
            p[~soft], k[~soft] = _of(self.laws, ~soft, g.shape[1]).loading(g[~soft])
        if soft.any():
            lowest = g[soft].min(axis=1, keepdims=True)
            g_m, laws = np.minimum(lowest, self.g[soft, None]), _of(self.laws, soft, 1)
            branch = _elastic(g[soft] - g_m, *laws.loading(g_m), *laws.vibration(g_m))
            p[soft], k[soft], moved = branch
            past[soft] = moved * (lowest < self.g[soft, None])
        return p, k, past


def _of(laws: EnrichedGap, chosen: Mask, times: int) -> EnrichedGap:
    """Laws of some elements at so many times, of gaps of the shape (elements, times)."""
    index = np.repeat(laws.index[chosen, None], times, axis=1)
    return EnrichedGap(laws.laws, index, laws.g_cr[chosen, None])


def _elastic(
    away: Array, p_m: Array, k_m: Array, v_m: Array, slope: Array
) -> tuple[Array, Array, Array]:
    """Pressure, stiffness and derivative to g_m of the branch from (g_m, p_m).

    Args:
        away: g - g_m [m], not negative.
        p_m: pressure at g_m [Pa].
        k_m: stiffness of loading there [Pa/m].
        v_m: stiffness of small vibrations there.
        slope: dv_m/dg_m [Pa/m^2].
    """
    n, carries = EXPONENT, p_m > 0
    p_safe = np.where(carries, p_m, 1.0)
    s = away * v_m / (n * p_safe)
    left = np.maximum(1 - s, 0.0) * carries
    ds = -v_m / (n * p_safe) + away * (slope + v_m * k_m / p_safe) / (n * p_safe)
    past = -k_m * left**n - n * p_m * left ** (n - 1) * ds
    return p_m * left**n, v_m * left ** (n - 1), past
