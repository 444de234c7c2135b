r"""Contact forces of patches over a period of vibration, exact in opening, yielding and reversal.

A patch carries w (p(g) - p_e) along the gap, p_e its pressure at equilibrium. Where a hardness
limits the pressure, unloading and reloading are elastic: from the smallest gap g_m that the patch
has had, at equilibrium or in the vibration, it goes back along

    p = p_m (1 - s)^n,    s = (g - g_m) v_m / (n p_m),    open for s >= 1,

p_m the pressure of loading to g_m and v_m the stiffness of small vibrations there; n = EXPONENT.
Friction mu(|v|) w p acts against the slip velocity v = (V - v_T, -v_R) of the disc past the pad,
with the rates that the scene's damping terms name. Without them its direction does not change, and
``reduced_bodies`` takes it as a part of the normal force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.macro.gap import EnrichedGap

from .harmonic_balance import Tangent

Array = NDArray[np.float64]

# Of the elastic branch under a hardness.
EXPONENT = 2.0

# Slip velocity below which the direction of friction is smoothed, over the sliding speed.
SMOOTH = 1e-3

# Speeds [m/s], shape (elements, times) -> friction coefficients and their slopes [s/m].
Coefficient = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class PatchForces:
    """Forces of some contact elements; see ``harmonic_balance.Forces``.

    Attributes:
        laws: law and critical gap of each element.
        yields: whether a hardness limits its pressure, shape (elements,).
        w: areas [m^2].
        g: gaps at equilibrium [m].
        mu: friction coefficient of each.
        speed: sliding speeds V [m/s].
        interface: number of the interface of each element.
        followed: motions that forces follow: "N", then "T" and "R" where they follow rates.
        coefficients: friction of each interface over the speed; none where it does not change.
    """

    laws: EnrichedGap
    yields: NDArray[np.bool_]
    w: Array
    g: Array
    mu: Array
    speed: Array
    interface: NDArray[np.int64]
    followed: str = "N"
    coefficients: tuple[Coefficient, ...] = ()

    def __call__(self, y: Array, v: Array) -> tuple[Array, Tangent]:
        """Forces beyond those of the equilibrium [N], and their tangent."""
        blocks, c = len(self.followed), self.w.size
        acting = self._acting
        y, v = y.reshape(blocks, c, -1), v.reshape(blocks, c, -1)
        time = np.argmin(y[0], axis=1)
        p, k, past = self.pressure(self.g[:, None] + y[0])
        p_e = self.pressure(self.g[:, None])[0]
        direction, slopes = self._directions(v)
        steady = np.zeros((acting, c, 1))
        steady[0], steady[1:2] = 1.0, self.mu[:, None]
        w = self.w[:, None]
        to_y = np.zeros((acting, blocks, c, y.shape[2]))
        to_y[:, 0] = -w * direction * k
        to_v = w * slopes * p if blocks > 1 else None
        tangent = Tangent(to_y, to_v, w * direction * past if past.any() else None, time)
        forces = w * (direction * p - steady * p_e)
        return forces.reshape(-1, y.shape[2]), tangent

    def pressure(self, g: Array) -> tuple[Array, Array, Array]:
        """Pressure p, -dp/dg and, where yielding goes on, dp/dg_m, shape (elements, times).

        Args:
            g: gaps over a period [m], shape (elements, times).
        """
        p, k, past = np.zeros((3, *g.shape))
        soft = self.yields
        if (~soft).any():
            p[~soft], k[~soft] = _loading(self.laws, ~soft, g[~soft])
        if soft.any():
            lowest = g[soft].min(axis=1, keepdims=True)
            g_m = np.minimum(lowest, self.g[soft, None])
            p_m, k_m = _loading(self.laws, soft, g_m)
            v_m, slope = self.laws.laws.vibration(*_seen(self.laws, soft, g_m))
            p[soft], k[soft], moved = _elastic(g[soft] - g_m, p_m, k_m, v_m, slope)
            past[soft] = moved * (lowest < self.g[soft, None])
        return p, k, past

    @property
    def _acting(self) -> int:
        """Blocks of acting rows."""
        return 1 if self.followed == "N" else 2 + ("R" in self.followed)

    def _directions(self, v: Array) -> tuple[Array, Array]:
        """Force over normal force along each acting row, and its derivatives to the velocities."""
        blocks, c, times = v.shape
        shape = c, times
        out, slopes = np.ones((self._acting, *shape)), np.zeros((self._acting, blocks, *shape))
        out[1:2] = self.mu[:, None]
        if blocks == 1:
            return out, slopes
        V, zero = self.speed[:, None], np.zeros((c, times))
        t, r = self.followed.find("T"), self.followed.find("R")
        along, across = V - (v[t] if t > 0 else zero), v[r] if r > 0 else zero
        small = np.where(V > 0, SMOOTH * V, 1.0)
        size = np.sqrt(along**2 + across**2 + small**2)
        mu, fall = out[1].copy(), zero.copy()
        for i, coefficient in enumerate(self.coefficients):
            own = self.interface == i
            mu[own], fall[own] = coefficient(size[own])
        m, dm = mu / size, (fall - mu / size) / size**2
        out[1] = m * along
        if t > 0:
            slopes[1, t] = -(m + dm * along**2)
        if r > 0:
            out[2] = -m * across
            slopes[1, r] = dm * along * across
            slopes[2, r] = -(m + dm * across**2)
            if t > 0:
                slopes[2, t] = dm * along * across
        return out, slopes


def _seen(laws: EnrichedGap, chosen: NDArray[np.bool_], g: Array) -> tuple[NDArray, Array]:
    """Numbers of laws and separations of some elements, of one shape."""
    index = np.broadcast_to(laws.index[chosen, None], g.shape)
    return index, g - laws.g_cr[chosen, None]


def _loading(laws: EnrichedGap, chosen: NDArray[np.bool_], g: Array) -> tuple[Array, Array]:
    return laws.laws.loading(*_seen(laws, chosen, g))


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
