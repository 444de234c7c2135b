"""Time steps of whole samples: the judge of their limit cycles.

The finite-element matrices are projected on the lowest real modes and the static shapes of all
contact forces; the contact is that of the laws. None of it is the reduced model of the package.
"""

import numpy as np
import scipy.linalg as la
import scipy.sparse.linalg as sla


class TimeSteps:
    """A sample about its equilibrium: x'' + C x' + K x = I (f(g) - f(g_e)), g = g_e + N x."""

    def __init__(self, brake, eq, laws, mu, C=None, modes=80, beyond=np.inf):
        """Project the matrices.

        Args:
            brake: operators.
            eq: equilibrium.
            laws: law and critical gap of each element.
            mu: friction of each element.
            C: damping [N s/m]; none if None.
            modes: real modes in the basis.
            beyond: modes above it have 3 % of critical damping more [Hz].
        """
        K, M, N, T, w = brake.K, brake.M, brake.N, brake.T, brake.w
        K0 = (K + N.T @ (N.multiply((w * eq.k)[:, None]))).tocsc()
        _, V = sla.eigsh(K0, modes, M.tocsc(), sigma=0.0, v0=np.ones(K.shape[0]))
        S = sla.splu(K0).solve(np.hstack([N.T.toarray(), T.T.toarray()]))
        S = S - V @ (V.T @ (M @ S))
        S = S / np.sqrt(np.sum(S * (M @ S), axis=0))
        B = np.hstack([V, S])
        d, U = la.eigh(B.T @ (M @ B))
        B = B @ (U[:, d > 1e-6] / np.sqrt(d[d > 1e-6]))
        self.K, self.N = B.T @ (K @ B), N @ B
        self.C = np.zeros_like(self.K) if C is None else B.T @ (C @ B)
        self.F = (self.N.T + (T @ B).T * mu) * w
        # Modes far beyond the band, which no mesh of a band resolves, flutter too: they are damped.
        kappa, V = la.eigh(self.K + self.N.T @ ((w * eq.k)[:, None] * self.N))
        omega = np.sqrt(np.maximum(kappa, 0))
        self.C += (V * np.where(omega > 2 * np.pi * beyond, 0.06 * omega, 0)) @ V.T
        self.laws, self.eq = laws, eq

    def linear(self):
        """Growing eigenvalue of smallest damping, and its vector."""
        A = self.K + self.F @ (self.eq.k[:, None] * self.N)
        n = len(A)
        s, X = la.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-A, -self.C]]))
        i = np.argmax(np.where(s.imag > 0, s.real, -np.inf))
        return s[i], X[:n, i]

    def run(self, seconds, step, amplitude=1e-8, start=None, kept=0.1):
        """Gaps beyond the equilibrium over the last share of the time, shape (times, elements).

        Central differences, the damping halved between the steps; they stand at the equilibrium
        but for a disturbance along the growing mode.
        """
        s, phi = self.linear()
        phi = phi if start is None else start
        phi = phi * amplitude / np.abs(self.N @ phi).max()
        x, before = phi.real, (phi * np.exp(-s * step)).real
        L = np.linalg.inv(np.eye(len(x)) + 0.5 * step * self.C)
        P0 = L @ (2 * np.eye(len(x)) - step**2 * self.K)
        P1 = L @ (0.5 * step * self.C - np.eye(len(x)))
        PF = step**2 * L @ self.F
        g, p = self.eq.g, self.laws.pressure(self.eq.g)
        count = int(seconds / step)
        out = []
        for i in range(count):
            moved = self.N @ x
            if i >= (1 - kept) * count:
                out.append(moved)
            x, before = P0 @ x + P1 @ before + PF @ (self.laws.pressure(g + moved) - p), x
        return np.array(out)


def measured(gaps, step, weights):
    """Amplitude and frequency of what is about periodic.

    Returns:
        Root mean square over the elements, with weights, of the first harmonic; frequency [Hz];
        change of the amplitude over the time that was kept.
    """
    rising = gaps[:, np.argmax(gaps.std(axis=0))]
    rising = rising - rising.mean()
    window = np.hanning(len(rising))
    spectrum = np.abs(np.fft.rfft(rising * window, 8 * len(rising)))
    f = np.fft.rfftfreq(8 * len(rising), step)
    peak = f[np.argmax(spectrum)]
    from scipy.optimize import minimize_scalar

    t = step * np.arange(len(rising))
    best = minimize_scalar(
        lambda v: -abs((rising * window) @ np.exp(-2j * np.pi * v * t)),
        bounds=(peak - 2 * f[1], peak + 2 * f[1]), method="bounded", options={"xatol": 1e-4},
    )  # fmt: skip
    parts = []
    for half in np.array_split(np.arange(len(t)), 2):
        win = np.hanning(half.size)
        turn = win * np.exp(-2j * np.pi * best.x * t[half])
        y = 2 * (turn @ (gaps[half] - gaps[half].mean(axis=0))) / win.sum()
        parts.append(np.sqrt(weights @ np.abs(y) ** 2))
    return float(np.mean(parts)), float(best.x), float(parts[1] / parts[0] - 1)
