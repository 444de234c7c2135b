"""Materials of a scene: engineering constants and stiffnesses, axes of parts, loss, refusals."""

import numpy as np
import pytest

from brake_fenicsx.build.material_table import in_axes, layer_materials, stiffness
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.material import (
    Material,
    engineering_constants,
    isotropic,
    rotate_about_z,
)
from brake_fenicsx.scene import MaterialTable, read_scene
from materials import LINING, ORTHOTROPIC
from places import SCENES


def of(model, **constants):
    return stiffness(MaterialTable(model, 1000.0, **constants))


def test_isotropic_both_ways():
    C = of("isotropic", E=2.1e11, nu=0.3)
    np.testing.assert_allclose(C, isotropic(2.1e11, 0.3))
    np.testing.assert_allclose(of("isotropic", C11=C[0, 0], C12=C[0, 1]), C, atol=1e-3)


def test_transversely_isotropic_both_ways():
    """The lining from its engineering constants; catches nu_31 in the place of nu_13."""
    e = engineering_constants(LINING)
    C = of(
        "transversely-isotropic",
        E=(e["E_x"], e["E_z"]),
        nu=(e["nu_xy"], e["nu_xz"]),
        G=e["G_xz"],
    )
    np.testing.assert_allclose(C, LINING, rtol=1e-12, atol=1e-2)
    same = of("transversely-isotropic", C11=5.94e9, C12=0.76e9, C13=0.98e9, C33=2.27e9, C44=1.18e9)
    np.testing.assert_array_equal(same, LINING)


def test_orthotropic_both_ways():
    """Nine stiffnesses in Voigt's order; catches C44 and C66 exchanged."""
    names = {"C11": (0, 0), "C22": (1, 1), "C33": (2, 2), "C12": (0, 1), "C13": (0, 2),
             "C23": (1, 2), "C44": (3, 3), "C55": (4, 4), "C66": (5, 5)}  # fmt: skip
    C = of("orthotropic", **{n: ORTHOTROPIC[i] for n, i in names.items()})
    np.testing.assert_allclose(C, ORTHOTROPIC, rtol=1e-12, atol=1e-3)
    G = (0.9e9, 1.3e9, 2.1e9)
    np.testing.assert_array_equal(
        of("orthotropic", E=(9e9, 5e9, 2e9), nu=(0.2, 0.35, 0.3), G=G), ORTHOTROPIC
    )


WRONG = [
    ("isotropic", {"E": 2e11}, "nu is missing"),
    ("isotropic", {"E": 2e11, "nu": 0.3, "C11": 1e9}, "E has no place here"),
    ("isotropic", {"E": (2e11, 1e9), "nu": 0.3}, "E has 2 values.*needs 1"),
    ("isotropic", {"C11": 1e9, "C12": 0.1e9, "C44": 1e9}, "C44 has no place here"),
    ("transversely-isotropic", {"C11": 1e9, "C12": 0.0}, "C13 is missing"),
    ("transversely-isotropic", {"E": (1e9, 1e9), "nu": (-1.0, 0.1), "G": 1e9}, "above -1"),
    ("orthotropic", {"E": 1e9, "nu": (0.1, 0.1, 0.1), "G": (1e9, 1e9, 1e9)}, "E has 1 values"),
]


@pytest.mark.parametrize("model, constants, text", WRONG)
def test_wrong_constants_are_named(model, constants, text):
    with pytest.raises(SceneError, match=text):
        of(model, **constants)


def test_offending_eigenvalue_is_in_the_message():
    """Stiffnesses with C12 above C11: the eigenvalue C11 - C12 of the plane's shear."""
    with pytest.raises(SceneError, match=r"eigenvalue -1e\+09 Pa"):
        Material(of("isotropic", C11=1e9, C12=2e9) + 0.0, 1.0)
    with pytest.raises(SceneError, match=r"eigenvalue -.* Pa"):
        of("isotropic", E=1e9, nu=0.6)


def test_half_a_turn_is_nothing_and_a_quarter_is_exact():
    """A pad at 90 degrees has its tangent along -x: the stiffness to the last bit."""
    material = Material(ORTHOTROPIC, 1.0, 0.02)
    for angle in (0.0, np.pi, -np.pi, 3 * np.pi):
        assert in_axes(material, angle) is material
    turned = in_axes(material, np.pi / 2)
    np.testing.assert_allclose(turned.C, rotate_about_z(ORTHOTROPIC, np.pi / 2), atol=1e-3)
    assert turned.loss == 0.02


def layers(changes, names=("pad.lining", "pad.plate", "pad.shim", "disc.body")):
    stages = "stages=['surface','micro','equilibrium','uncertainty']"  # where no loss has to act
    scene = read_scene(SCENES / "disc_brake.toml", [stages, *changes])
    return layer_materials(scene, names)


STIFF = "materials.lining={model='orthotropic', rho='2510 kg/m^3', E=['9 GPa','5 GPa','2 GPa'],"
STIFF += " nu=[0.2,0.35,0.3], G=['0.9 GPa','1.3 GPa','2.1 GPa'], loss=0.03}"


def test_axis_1_of_a_pad_is_its_tangent():
    """At 90 degrees x, at 0 degrees y, whatever the pad's place; a part's own axis replaces it."""
    for change, direction in (
        ([], "E_x"),
        (["parts.pad.position=0 deg"], "E_y"),
        (["parts.pad.axis=90 deg"], "E_y"),
        (["parts.pad.axis=0 deg", "materials.lining.axis=90 deg"], "E_y"),
    ):
        found = layers([STIFF, *change])["pad.lining"]
        assert engineering_constants(found.C)[direction] == pytest.approx(9e9), change
        assert found.loss == 0.03


def test_pads_beside_each_other_have_their_own_axes():
    """At 60 degrees the tangent lies at 150 degrees from x."""
    found = layers([STIFF, "parts.pad.position=60 deg"])["pad.lining"]
    wanted = rotate_about_z(ORTHOTROPIC, np.deg2rad(150))
    np.testing.assert_allclose(found.C, wanted, atol=1.0)


def test_one_material_for_all_layers_of_a_shim_or_one_for_each():
    """shim2 takes the material of "shim2", or else that of "shim"."""
    names = ("pad.shim1", "pad.shim2")
    both = layers([], names)
    assert engineering_constants(both["pad.shim2"].C)["E_x"] == pytest.approx(207e9)
    own = "parts.pad.material={lining='lining', plate='steel', shim1='steel', shim2='iron'}"
    assert engineering_constants(layers([own], names)["pad.shim2"].C)["E_x"] == pytest.approx(125e9)
    with pytest.raises(SceneError, match=r"parts.pad.material: no material for layer 'shim3'"):
        layers([own], ("pad.shim3",))


def test_a_negative_loss_factor_is_refused():
    with pytest.raises(SceneError, match="loss"):
        Material(LINING, 1.0, -0.1)
    with pytest.raises(SceneError, match=r"materials.iron.loss.*zero or more"):
        read_scene(SCENES / "disc_brake.toml", ["materials.iron.loss=-0.1"])
