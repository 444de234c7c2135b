r"""Whether vibrations near a limit cycle come to it: its Floquet exponents.

A small change of a cycle obeys linear equations whose contact stiffness varies with the period.
They are stepped over one period, exactly but for what the stiffness differs from its mean, which
acts in kicks at the points of time (Strang 1968); ln(rho) / period of the eigenvalues rho of the
product are the exponents mu. There the compliance D of what the kept modes leave out is real and
that of the first harmonic. Its change with lambda, D(mu + i n omega) of harmonic n, shifts mu to
first order,

    d rho = sum over times of (left vector) (change of the kick),

with vectors that are stepped forwards and backwards. The exponent of a shift in time is zero: what
is found for it is the error of the others. The memory of a hardness is left out: changes are
elastic.
"""

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import Complex

from .bodies import times
from .growth import STABLE
from .harmonic_balance import HarmonicBalance, Vibration
from .newton_steps import across

# Exponents that are shifted, those of largest growth; steps of inverse iteration, and the relative
# distance of its shift.
MOST, STEPS, APART = 4, 3, 1e-9

# Share of omega within which two frequencies are one.
SAME = 1e-4

GIVES_WAY, UNDECIDED = "gives way", "undecided"


def verdict(growth: float, error: float, ratio: float) -> str:
    """Outcome of a cycle that is stable along its branch.

    Args:
        growth: largest real part of the exponents, but for that of a shift in time [1/s].
        error: of the exponents [1/s].
        ratio: imaginary part of that exponent over omega, 0 to 0.5.
    """
    if abs(growth) <= error:
        return UNDECIDED
    names = {0.0: "another cycle", 0.5: "its period doubles"}
    near = (name for at, name in names.items() if abs(ratio - at) < SAME)
    return f"{GIVES_WAY}: {next(near, 'a second frequency')}" if growth > error else STABLE


def exponents(problem: HarmonicBalance, at: Vibration) -> Complex:
    """Floquet exponents of a cycle [1/s], imaginary parts from 0 to omega / 2.

    Args:
        problem: its equations; more points of time make the exponents better.
        at: the cycle.

    Returns:
        That of a shift in time, then others of largest growth, shape (MOST + 1 or fewer,).
    """
    bodies, omega, points = problem.bodies, at.s.imag, problem.points
    period = 2 * np.pi / omega
    h, tangent = period / points, problem.contact(at)[1]
    still, (moving, *others) = bodies.at(0j)[0].real, bodies.at(1j * omega)
    lead, source, D = (A.real.copy() for A in others)
    M, m = (still - moving.real) / omega**2, len(still)
    push, own = la.solve(M, lead), la.solve(M, np.hstack([still, moving.imag / omega]))
    Y = np.moveaxis(tangent.y, -1, 0)
    R = np.array([np.linalg.inv(np.eye(D.shape[1]) - across(J, D)) for J in Y])
    F = np.array([r @ across(J, source) for r, J in zip(R, Y, strict=True)])
    if tangent.v is not None:
        V = np.moveaxis(tangent.v, -1, 0)
        F = np.dstack([F, [r @ across(J, source) for r, J in zip(R, V, strict=True)]])
    kicks = push @ F
    own[:, : kicks.shape[2]] -= kicks.mean(axis=0)
    kicks = h * (kicks - kicks.mean(axis=0))
    n = kicks.shape[2]
    flow = la.expm(h * np.block([[np.zeros((m, m)), np.eye(m)], [-own]]))
    P = np.eye(2 * m)
    for kick in kicks:
        P[m:] += kick @ P[:n]
        P = flow @ P
    rho = la.eigvals(P)
    mu = np.log(rho + 0j) / period
    order = [i for i in np.argsort(-mu.real) if mu[i].imag >= 0]
    shift = min(order, key=lambda i: abs(mu[i]))
    t, found = h * np.arange(points), []
    for i in [shift, *(i for i in order if i != shift)][: MOST + 1]:
        factors = la.lu_factor(P - (1 + APART) * rho[i] * np.eye(2 * m))
        x, left = np.ones((2, 2 * m), complex)
        for _ in range(STEPS):
            x, left = la.lu_solve(factors, x), la.lu_solve(factors, left, trans=2)
            x, left = x / la.norm(x), left / la.norm(left)
        size, forces, left = left.conj() @ x, [], left.conj()
        for f, kick in zip(F, kicks, strict=True):
            forces.append(f @ x[:n])
            x = flow @ np.r_[x[:m], x[m:] + kick @ x[:n]]
        turn = np.exp(mu[i] * t)
        harmonics = np.fft.fft(np.array(forces).T / turn) / points
        lam = mu[i] + 1j * omega * np.fft.fftfreq(points, 1 / points)
        gap = bodies.motions(lam, np.zeros((m, points), complex), harmonics) - times(D, harmonics)
        gap, moved = np.fft.ifft(gap) * points * turn, 0j
        for k in reversed(range(points)):
            left = left @ flow
            moved += h * left[m:] @ (push @ (R[k] @ across(Y[k], gap[:, k : k + 1])[:, 0]))
            left[:n] += left[m:] @ kicks[k]
        found.append(np.log(rho[i] + moved / size) / period)
    return np.real(found) + 1j * np.abs(np.imag(found))
