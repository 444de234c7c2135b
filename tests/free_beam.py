"""A free Timoshenko beam in closed form: receptances and modes."""

import numpy as np
from scipy.optimize import brentq

LENGTH, WIDTH, HEIGHT, E, NU, RHO = 0.2, 0.02, 0.012, 125e9, 0.24, 7200.0


def beam(f, x, beta=0.0):
    """Receptance at x to a force across its end -L/2 [m/N].

    E and G have the factor 1 + i omega beta, as the stiffness with Rayleigh's beta. Of the waves
    exp(l x) each has the rotation (l^2 + g) / l; ends are free of moment, and of shear force but
    for the force. Shear coefficient: Cowper, J. Appl. Mech. 33 (1966) 335.
    """
    omega = 2 * np.pi * f
    loss = 1 + 1j * omega * beta
    shear = 10 * (1 + NU) / (12 + 11 * NU) * E / 2 / (1 + NU) * loss
    g, h = RHO * omega**2 / shear, RHO * omega**2 / (E * loss)
    bent = RHO * 12 / HEIGHT**2 * omega**2 / (E * loss)
    wave = np.roots([1, 0, g + h, 0, g * h - bent])
    turn = (wave**2 + g) / wave
    rows = []
    for end in (-LENGTH / 2, LENGTH / 2):
        e = np.exp(wave * end)
        rows += [turn * wave * e, shear * WIDTH * HEIGHT * (wave - turn) * e]
    c = np.linalg.solve(np.array(rows), [0, -1, 0, 0])
    return np.exp(np.outer(x, wave)) @ c


def free_beam(number):
    """Lowest bending modes: frequencies [Hz], deflections w(x) as receptances beside the pole."""

    def stiffness(f):
        return 1 / beam(f, [-LENGTH / 2])[0].real

    grid = np.linspace(100.0, 16e3, 400)
    signs = np.sign([stiffness(f) for f in grid])
    found = [brentq(stiffness, *grid[i : i + 2]) for i in np.flatnonzero(np.diff(signs))]
    # It changes its sign through infinity, too.
    modes = [f for f in found if abs(stiffness(f)) < 1e4][:number]
    return [(f, lambda x, f=f: beam(f * (1 + 1e-9), x).real) for f in modes]
