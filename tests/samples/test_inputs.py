"""Random scalars of a scene: which, in what units, what is rejected."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from brake_fenicsx.build.material_table import constants, stiffness, varied_stiffness
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.material import engineering_constants
from brake_fenicsx.samples.sampling import (
    Roughness,
    draw_inputs,
    draw_sample,
    law_factor,
    one_law,
    points_of,
    sample_count,
)
from brake_fenicsx.scene import LawTable, MaterialTable, read_scene
from brake_fenicsx.scene.digest import result_digest
from brake_fenicsx.surface import match_moments
from coarse_block import BLOCK
from contact_alone import at_contact

STAGES = "stages=['surface','equilibrium','stability','uncertainty']"
CONTACT = SimpleNamespace(interface=np.zeros(20, dtype=int), speed=np.full(20, 2.0))
HEIGHTS = Roughness(hdf=match_moments(33.1e-6, -0.241, 3.6549))
ROUGH = [STAGES, "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf"]


def random(key, law):
    return f'samples.random."{key}"={law}'


def scene(*changes):
    return read_scene(BLOCK, [*ROUGH, *changes])


def lining(**changes):
    return scene().materials["lining"]


@pytest.mark.parametrize(
    ("key", "law", "remedy"),
    [
        ("contact.nobody.friction", "{ law='uniform', min=0.1, max=0.2 }", "block_plate"),
        ("parts.block.size", "{ law='uniform', min=1, max=2 }", "--set parts.block.size"),
        ("materials.lining.axis", "{ law='uniform', spread=0.1 }", "materials.NAME.E|E_1"),
        ("materials.lining.E_3", "{ law='normal', mean=1.9, sd=0.1 }", "unit is missing"),
        ("materials.lining.nu_13", "{ law='uniform', spread=0.1 }", "nu_31"),
        ("materials.iron.E_1", "{ law='uniform', spread=0.1 }", "E and nu"),
        ("materials.iron.C11", "{ law='uniform', spread=0.1 }", "engineering constant"),
        ("contact.block_plate.friction", "{ law='normal', mean=0.5 }", "mean and sd"),
        ("contact.block_plate.friction", "{ law='uniform', min=0.5, max=0.4 }", "must lie below"),
        ("contact.block_plate.friction", "{ law='uniform', min=0.5 }", "min and max, or spread"),
        ("contact.block_plate.friction", "{ law='uniform', spread=1.5 }", "below 1"),
        ("contact.block_plate.friction", "{ law='measured', values=[0.5] }", "two values"),
        ("contact.block_plate.friction", "{ law='measured', file='no.txt' }", "no such file"),
        ('loads.\\"block.top\\".pressure', "{ law='gauss' }", "normal, lognormal"),
    ],
)
def test_wrong_random_input_is_one_line_with_its_remedy(key, law, remedy):
    with pytest.raises(SceneError) as error:
        scene(random(key, law))
    assert remedy in str(error.value)


def test_constants_by_two_ways_and_missing_inputs_are_refused():
    both = [
        random("materials.lining.C44", "{ law='uniform', spread=0.1 }"),
        random("materials.lining.E_3", "{ law='uniform', spread=0.1 }"),
    ]
    with pytest.raises(SceneError, match="use one kind"):
        scene(*both)
    with pytest.raises(SceneError, match=r"samples.random"):
        scene("samples.approaches=['joint']")


def test_axial_modulus_changes_alone():
    """E_3 at fixed E_1, nu_12, nu_31: with nu_13 fixed instead, nu_31 would move by 20 %."""
    table = lining()
    before = constants(table)
    C = varied_stiffness(table, {"E_3": 0.8 * before["E_3"], "G_13": 1.0e9})
    found = engineering_constants(C)
    assert found["E_z"] == pytest.approx(0.8 * 1983.3e6, rel=1e-4)
    assert found["nu_zx"] == pytest.approx(before["nu_31"], rel=1e-12)
    assert found["nu_xz"] == pytest.approx(before["nu_31"] * before["E_1"] / found["E_z"])
    assert (found["G_xz"], found["G_yz"]) == pytest.approx((1.0e9, 1.18e9))
    for name in ("E_x", "E_y", "nu_xy", "G_xy"):
        assert found[name] == pytest.approx(engineering_constants(stiffness(table))[name])


def test_stiffness_constant_keeps_the_model_of_its_table():
    C = varied_stiffness(lining(), {"C44": 1.0e9})
    np.testing.assert_array_equal(np.diag(C)[3:5], 1.0e9)


def test_isotropic_modulus():
    table = MaterialTable("isotropic", 7200.0, E=125e9, nu=0.24)
    C = varied_stiffness(table, {"E": 250e9})
    np.testing.assert_allclose(C, 2 * stiffness(table), rtol=1e-14)


IMPOSSIBLE = "{ law='uniform', min=0.0, max=0.9 }"


def test_impossible_material_is_drawn_again_and_counted():
    """nu_31 beyond sqrt(E_3 / E_1) is no material; samples stay independent of each other."""
    s = scene(random("materials.lining.nu_31", IMPOSSIBLE))
    drawn = [draw_inputs(s, "multi-scale", None, np.random.default_rng(k)) for k in range(40)]
    assert sum(rejected for _, rejected in drawn) > 5
    for d, _ in drawn:
        assert np.linalg.eigvalsh(d.materials["lining"])[0] > 0
    again = draw_inputs(s, "multi-scale", None, np.random.default_rng(39))
    assert again == drawn[39]


def test_rejected_point_of_a_rigid_design_is_an_error():
    """A point drawn again would leave the search curve of FAST."""
    approach = "samples.approaches=['parametric']"
    s = scene(
        random("materials.lining.nu_31", IMPOSSIBLE), approach, "samples.parametric.design=fast"
    )
    with pytest.raises(InaccurateResult, match=r"draw rejected: materials.lining"):
        draw_inputs(s, "parametric", np.array([0.99]), np.random.default_rng(0))
    lhs = scene(
        random("materials.lining.nu_31", IMPOSSIBLE), approach, "samples.parametric.design=rbd-fast"
    )
    found = draw_inputs(lhs, "parametric", np.array([0.99]), np.random.default_rng(0))
    assert found[1] >= 1


def test_no_draw_within_a_fifth_of_the_lining_is_rejected():
    """nu_13 = 0.507 at 0.8 E_3 is a material, though beyond the 0.5 of an isotropic one."""
    s = scene(random("materials.lining.E_3", "{ law='uniform', spread=0.2 }"))
    low, rejected = draw_inputs(s, "multi-scale", np.array([0.0]), np.random.default_rng(0))
    assert rejected == 0
    assert engineering_constants(low.materials["lining"])["nu_xz"] > 0.5
    assert law_factor("block_plate", low) > 0.8


def test_no_draw_possible_is_said():
    s = scene(random("materials.lining.nu_31", "{ law='uniform', min=5, max=6 }"))
    with pytest.raises(InaccurateResult, match="all of 1000 draws rejected"):
        draw_inputs(s, "multi-scale", None, np.random.default_rng(0))


def test_measured_file_has_a_unit_and_belongs_to_the_results(tmp_path):
    """A factor of 1e6 in a modulus; and stored samples must not survive another file."""
    target = tmp_path / "scene.toml"
    target.write_text(BLOCK.read_text())
    (tmp_path / "G.txt").write_text("1100\n1200\n1300\n")
    law = "{ law='measured', file='G.txt', unit='MPa' }"
    changes = [*ROUGH, random("materials.lining.G_13", law)]
    s = read_scene(target, changes)
    d = s.samples.random["materials.lining.G_13"]
    assert d.values == pytest.approx((1.1e9, 1.2e9, 1.3e9))
    (tmp_path / "G.txt").write_text("1100\n1200\n1301\n")
    assert result_digest(read_scene(target, changes)) != result_digest(s)
    with pytest.raises(SceneError, match="unit: missing"):
        read_scene(
            target, [*ROUGH, random("materials.lining.G_13", "{ law='measured', file='G.txt' }")]
        )


def test_values_of_npz_by_name(tmp_path):
    target = tmp_path / "scene.toml"
    target.write_text(BLOCK.read_text())
    np.savez(tmp_path / "mu.npz", a=[0.4, 0.5], b=[0.6, 0.7])
    key = "contact.block_plate.friction"
    s = read_scene(target, [*ROUGH, random(key, "{ law='measured', file='mu.npz', array='b' }")])
    assert s.samples.random[key].values == (0.6, 0.7)
    with pytest.raises(SceneError, match="contains a, b; name one"):
        read_scene(target, [*ROUGH, random(key, "{ law='measured', file='mu.npz' }")])


MU = random("contact.block_plate.friction", "{ law='uniform', min=0.3, max=0.7 }")
E3 = random("materials.lining.E_3", "{ law='uniform', spread=0.2 }")


def test_multi_scale_beside_joint_is_roughness_alone():
    """Four approaches in one scene: each cause alone, and all together."""
    names = "samples.approaches=['multi-scale','parametric','classical','joint']"
    s = scene(names, MU, E3, "samples.n=500")
    drawn = {a: draw_sample(s, a, 0, at_contact(CONTACT), HEIGHTS) for a in s.samples.approaches}
    assert {a: sorted(d.values) for a, d in drawn.items()} == {
        "multi-scale": [], "classical": [],
        "parametric": ["contact.block_plate.friction", "materials.lining.E_3"],
        "joint": ["contact.block_plate.friction", "materials.lining.E_3"],
    }  # fmt: skip
    assert np.any(drawn["joint"].laws.g_cr)
    assert not np.any(drawn["parametric"].laws.g_cr)
    counts = [sample_count(s, a) for a in s.samples.approaches]
    assert counts == [500, 500, 1, 500]
    assert points_of(s, "joint") is None
    assert points_of(s, "parametric").shape == (500, 2)


LIBRARY = [
    STAGES.replace("'equilibrium'", "'micro','equilibrium'"), "micro={ patch='3 mm', pixels=16 }",
    "contact.block_plate.law=library",
]  # fmt: skip


def test_computed_laws_scale_with_the_modulus_of_the_sample():
    """E* = E_3 / (1 - nu_13^2) with nu_13 = nu_31 E_1 / E_3: not the ratio of E_3 alone."""
    s = scene(E3, *LIBRARY)
    library = one_law(LawTable(p0=10e6, u0=1e-5))
    d = draw_sample(s, "multi-scale", 3, at_contact(CONTACT), replace(HEIGHTS, library=library))
    c, E = constants(s.materials["lining"]), d.values["materials.lining.E_3"]
    star = lambda e: e / (1 - (c["nu_31"] * c["E_1"] / e) ** 2)  # noqa: E731
    expected = star(E) / star(c["E_3"])
    assert law_factor("block_plate", d.values) == pytest.approx(expected, rel=1e-9)
    g = d.laws.g_cr + 1e-6
    assert d.laws.pressure(g) == pytest.approx(expected * 10e6 * np.exp(-0.1), rel=1e-9)


def test_written_laws_stay_as_written():
    for law in ("{ linear = '2e13 Pa/m' }", "{ p0 = '10 MPa', u0 = '10 um' }"):
        s = scene(E3, f"contact.block_plate.law={law}")
        d = draw_sample(s, "multi-scale", 3, at_contact(CONTACT), HEIGHTS)
        same = one_law(s.contact["block_plate"].law)
        g = np.full(d.laws.g_cr.size, -1e-6)
        found, expected = d.laws.loading(d.laws.g_cr + g), same.loading(0 * d.laws.index, g)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
