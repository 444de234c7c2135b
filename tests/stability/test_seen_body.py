"""What interface and kept modes see of the rest of a body, on a chain, against dense inverses."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.stability.substructures.component import Products, SeenBody
from brake_fenicsx.stability.substructures.contact_rows import SIGMA, Rows
from brake_fenicsx.stability.substructures.polynomials import (
    Polynomial,
    imaginary_points,
    real_points,
)
from brake_fenicsx.stability.substructures.reduction import proportional

NODES, ELEMENTS, CUTOFF = 120, 12, 1.8
UNDAMPED, DAMPED = Rows("N", False), Rows("NT", True)


def chain(damping, rows, softer=1.0):
    """A held chain, 25 modes in the band, and its dense matrices; ``softer`` at its end."""
    rng, n = np.random.default_rng(3), NODES
    k = 1 + 0.3 * rng.random(n)
    ends = sp.diags([1.0, -1.0], [0, -1], (n, n)).tocsr()
    K, M = ends.T @ sp.diags(k) @ ends, sp.diags(1 + 0.2 * rng.random(n)).tocsr()
    end = la.eigvalsh(K.toarray(), M.toarray())[24:26].mean()
    K = K / end
    kappa, W = la.eigh(K.toarray(), M.toarray(), subset_by_value=(-1, CUTOFF**2))
    loss = np.where(np.arange(n) < n // 3, 0.2, 0.01)
    C = {
        "none": None,
        "proportional": 0.01 * M + 0.02 * K,
        "unequal": (ends.T @ sp.diags(k * loss / end) @ ends + 0.003 * M).tocsr(),
        "turning": (0.02 * sp.diags([1.0, -1.0], [1, -1], (n, n))).tocsr(),
    }[damping]
    weak = np.where(np.arange(n) > n // 2, softer, 1.0)
    K = (ends.T @ sp.diags(weak * k / end) @ ends).tocsr()
    every = sp.identity(n, format="csr")[rng.choice(n, 3 * ELEMENTS, replace=False)]
    interface = {name: every[i::3] for i, name in enumerate("NTR")}
    load = rng.standard_normal((n, 1))
    coupled = damping in ("unequal", "turning") or softer != 1.0
    kept = Products(M @ W, W.T @ K @ W, W.T @ M @ W) if coupled else kappa
    body = SeenBody(K, C, M, W, M, interface, load, rows, kept)
    return body, kappa


def exact(body, s):
    """[O; W'P] S [I', P W, F] with a dense basis of what is orthogonal to the kept modes."""
    P = (body.K + s**2 * body.M).toarray() + (0 if body.C is None else s * body.C.toarray())
    V = la.null_space((body.centre @ body.W).T)
    S = V @ la.solve(V.T @ P @ V, V.T)
    O, I = (np.vstack([body.interface[n].toarray() for n in names])
            for names in (body.rows.followed, body.rows.acting))  # fmt: skip
    if not body.coupled:
        return O @ S @ np.hstack([I.T, body.loads])
    return np.vstack([O, body.W.T @ P]) @ S @ np.hstack([I.T, P @ body.W, body.loads])


@pytest.mark.parametrize(
    ("damping", "rows", "softer", "s"),
    [
        ("none", UNDAMPED, 1.0, 0.6j),
        ("none", UNDAMPED, 1.0, 0.01),
        ("none", UNDAMPED, 0.8, 0.6j),
        ("unequal", DAMPED, 1.0, 0.6j),
        ("unequal", DAMPED, 0.8, 0.01),
        ("turning", DAMPED, 1.0, 0.6j),
        ("turning", DAMPED, 0.8, 0.01),
    ],
)
def test_values_at_one_frequency(damping, rows, softer, s):
    """Real and complex, symmetric and not; kept modes of another chain couple."""
    body, _ = chain(damping, rows, softer)
    found, wanted = body.at(s), exact(body, s)
    assert np.iscomplexobj(found) == (damping != "none" and bool(np.imag(s)))
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("near", [0, 3])
@pytest.mark.parametrize("damping", ["none", "unequal", "turning"])
def test_values_at_one_frequency_after_another(damping, near):
    """By one analysis of a pattern, also with more kept modes solved for than are close."""
    body = replace(chain(damping, DAMPED)[0], near=near)
    for s in (0.01, 0.6j, 0.02, 0.3j, 0.9j):
        found, wanted = body.at(s), exact(body, s)
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    (held,) = body.factors
    body.destroy()
    assert not body.factors and not held._F


@pytest.mark.parametrize("count", [2, 3, 4, 5])
@pytest.mark.parametrize("damping, rows", [("none", UNDAMPED), ("unequal", DAMPED)])
def test_error_at_the_end_of_the_band_bounds_that_within(damping, rows, count):
    """At all frequencies of the band, and beyond; each point more gains at least four times."""
    body, kappa = chain(damping, rows)
    errors = []
    for number in (count, count + 1):
        points = (imaginary_points if rows.damped else real_points)(number, kappa)
        s = points if rows.damped else np.sqrt(-points + 0j)
        values = [body.at(one) for one in s]
        p = Polynomial(points, rows)
        c = p.coefficients(values[:-1])
        at_end = np.linalg.norm(p.missing(c, values[-1]))
        errors.append(at_end)
        for f in (0.01, 0.2, 0.37, 0.61, 0.83, 0.97, 1.1):
            w = np.array([1j * f - rows.shift if rows.damped else f**2 + SIGMA], complex)
            off = np.linalg.norm(
                np.tensordot(w[0] ** np.arange(p.count), c, 1) - exact(body, 1j * f)
            )
            assert off <= 1.5 * at_end * p.growth(w, CUTOFF)[0] + 1e-9 * np.linalg.norm(values[-1])
    assert errors[1] < errors[0] / 4


def test_proportional_damping_is_seen():
    """alpha and beta; damping by layers, or skew, has none."""
    for damping, shares in (("none", (0, 0)), ("proportional", (0.01, 0.02))):
        body, _ = chain(damping, DAMPED)
        np.testing.assert_allclose(proportional(body.K, body.C, body.M), shares, atol=1e-12)
    for damping in ("unequal", "turning"):
        body, _ = chain(damping, DAMPED)
        assert proportional(body.K, body.C, body.M) is None


def test_points_keep_away_from_eigenvalues():
    """An eigenvalue at each point: they move by a little, not into the next one."""
    points = real_points(5, np.zeros(0))
    assert points[0] < 0 and points[-1] == 1.0 and np.all(np.diff(points) > 0)
    close = np.r_[points, points[1:] + 2e-3]
    moved = real_points(5, close)
    apart = np.abs(moved[1:, None] - close).min()
    assert apart > 1e-3 and np.abs(moved - points).max() <= 2e-2
