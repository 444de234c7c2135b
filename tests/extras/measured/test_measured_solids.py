"""Resonances of three solids against measurements, and of the box against Rayleigh-Ritz."""

import importlib.util

import numpy as np
import pytest

from brake_fenicsx.build.material_table import stiffness
from brake_fenicsx.extras.measured.part_modes import part_modes
from brake_fenicsx.scene import read_scene
from places import ROOT
from ritz import box_frequencies

SCENES = ROOT / "scripts" / "scenes" / "measured"
ALUMINIUM, CRYSTAL = (11.92e-3, 10.93e-3, 9.86e-3), (1.490e-3, 2.035e-3, 3.020e-3)


def script():
    spec = importlib.util.spec_from_file_location("solids", ROOT / "scripts" / "measured_solids.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def reference(name, lengths, degree):
    (table,) = read_scene(SCENES / f"{name}.toml").materials.values()
    return box_frequencies(lengths, stiffness(table), table.rho, degree)


def test_ritz_has_the_shear_modes_of_an_isotropic_cube():
    """Lowest mode of a cube of side L: equivoluminal (Lame), f = sqrt(G / (2 rho)) / L, exact."""
    E, nu, rho, side = 70e9, 0.3, 2700.0, 0.01
    G = E / (2 * (1 + nu))
    C = np.zeros((6, 6))
    C[:3, :3] = E * nu / ((1 + nu) * (1 - 2 * nu))
    C[:3, :3] += 2 * G * np.eye(3)
    C[3:, 3:] = G * np.eye(3)
    found = box_frequencies((side, side, side), C, rho, 12)
    assert np.abs(found / (np.sqrt(G / 2 / rho) / side) - 1).min() < 1e-7


@pytest.mark.parametrize(
    ("name", "lengths", "size", "tolerance"),
    [
        ("aluminium_box", ALUMINIUM, "2 mm", 1.5e-3),
        ("srtio3_box", CRYSTAL, "0.4 mm", 1.5e-3),
        pytest.param("aluminium_box", ALUMINIUM, "1.5 mm", 5e-4, marks=pytest.mark.slow),
        pytest.param("srtio3_box", CRYSTAL, "0.3 mm", 5e-4, marks=pytest.mark.slow),
    ],
)
def test_first_modes_of_a_box(name, lengths, size, tolerance):
    """From above, as of any conforming elements; isotropic and cubic."""
    exact = reference(name, lengths, 12)[:10]
    scene = read_scene(SCENES / f"{name}.toml", [f"parts.box.size='{size}'"])
    found = part_modes(scene, "box", np.zeros((1, 3)), 1.002 * exact[-1]).frequency[:10]
    assert np.all(found > exact * (1 - 1e-5))
    assert np.abs(found / exact - 1).max() < tolerance


@pytest.mark.slow
def test_all_modes_of_the_aluminium_box_are_those_of_ritz():
    _, computed, _ = script().compared("aluminium_box")
    exact = reference("aluminium_box", ALUMINIUM, 16)[:42]
    assert np.abs(computed[:42] / exact - 1).max() < 1e-4


@pytest.mark.parametrize(
    ("name", "changes", "off", "largest"),
    [
        pytest.param("aluminium_box", (), 0.25, 0.66, marks=pytest.mark.slow),
        pytest.param("srtio3_box", (), 0.36, 0.90, marks=pytest.mark.slow),
        ("fan_blade", ("parts.blade.size='20 mm'", "parts.blade.plate_size='20 mm'"), 2.5, 5.0),
    ],
)
def test_measured(name, changes, off, largest):
    """Every measured resonance has its mode, and the page's figures are those computed."""
    module = script()
    measured, computed, mode = module.compared(name, changes)
    assert np.all(mode >= 0)
    rms, worst = (100 * x for x in module.rms(measured, computed, mode))
    assert rms < off and worst < largest
