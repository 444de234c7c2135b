"""Lengths of builders that move planes along z: against closed forms and scenes meshed anew."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import compat, model
from brake_fenicsx.build.bodies import assemble_bodies
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.build.interfaces import interface_elements
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from full_order import agrees, at_full_order
from places import VENTED

SETS = [
    "stages=['equilibrium','stability']", "samples={ approaches=['multi-scale'] }",
    "stability.method=reduced",
]  # fmt: skip
# A full disc; and few vanes: gmsh cuts 24 out of a disc for seconds.
PLAIN = [
    'parts.disc={ builder="disc", radius="160 mm", thickness="24 mm", size="40 mm",'
    ' face_size="30 mm", material="iron" }',
    'supports={ "disc.bore"="clamped" }', "mesh.quality=0.002",
]  # fmt: skip
VANES = "parts.disc.vanes=6"
# Of a pad between straight edges volumes are exact.
PAD = [*PLAIN, "parts.pad.shape='rectangle'", "parts.pad.ear_length=0", "springs={}",
       'supports={ "disc.bore"="clamped", "pad.piston"=["x", "y"] }']  # fmt: skip
SLOT, CHAMFER = "parts.pad.slot_depth", "parts.pad.chamfer_depth"
LINING = "parts.pad.lining"
COARSE = ["parts.disc.size='40 mm'", "parts.disc.face_size='40 mm'", VANES,
          *(f"parts.pad.{part}size='24 mm'" for part in ("", "plate_", "shim_")),
          "mesh.quality=0.001"]  # fmt: skip
DISC = {
    # Heights of the scene, and where a longer length has them.
    "thickness": (22e-3, [-12, -4, 4, 12, 34, 42], [-11, -3, 3, 11, 33, 41]),
    "cheek": (9.5e-3, [-12, -4, 4, 12, 34, 42], [-12, -2.5, 2.5, 12, 34, 42]),
    "hat": (33e-3, [-12, -4, 4, 12, 34, 42], [-12, -4, 4, 12, 37, 45]),
    "flange": (7e-3, [-12, -4, 4, 12, 34, 42], [-12, -4, 4, 12, 35, 42]),
}


def changed(sets, key, length):
    """A scene whose length varies, its brake, and what a value of it adds."""
    near = 1e3 * length
    values = f'["{near!r} mm", "{0.99 * near!r} mm"]'
    sweep = f'sweep.parameters={{ "{key}"={{ values={values} }} }}'
    scene = read_scene(VENTED, [*SETS, *sets, sweep])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    return (
        scene,
        brake,
        changes.change({key: length}, "K"),
        changes.change({key: length}, "M"),
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if n in ("hat", "flange") else ()) for n in DISC],
)
def test_a_length_of_a_vented_disc_moves_its_planes(name):
    """Matrices of the mesh whose nodes are moved by hand, cells between planes in proportion."""
    length, here, there = DISC[name]
    scene, brake, K, M = changed(COARSE, f"parts.disc.{name}", length)
    mesh = brake.mesh
    x = mesh.domain.geometry.x
    own = np.unique(compat.geometry_dofs(mesh.domain)[mesh.cells_of("disc")])
    x[own, 2] = np.interp(x[own, 2], 1e-3 * np.array(here), 1e-3 * np.array(there))
    exact = assemble_bodies(scene, mesh)
    assert abs(K).max() > 1e-3 * abs(exact.K).max()
    assert abs(brake.K + K - exact.K).max() < 1e-9 * abs(exact.K).max()
    assert abs(brake.M + M - exact.M).max() < 1e-9 * abs(exact.M).max()


@pytest.mark.parametrize(
    ("key", "length", "area"),
    [(SLOT, 8.5e-3, 4e-3 * 44e-3), (CHAMFER, 4e-3, 8e-3 * 44e-3)],
)
def test_volume_of_a_pad_follows_its_slot_and_chamfers(key, length, area):
    """A slot has the volume width x depth x length, two chamfers their triangles: in both pads."""
    _, brake, _, M = changed(PAD, key, length)
    usual = {SLOT: 7e-3, CHAMFER: 3e-3}[key]
    column = np.zeros(brake.M.shape[0])
    z = np.flatnonzero(brake.elastic.free.local % 3 == 2)
    column[z] = 1.0
    assert column @ M @ column == pytest.approx(-2 * 2510 * area * (length - usual), rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "lengths", "shape"),
    [("chamfer", (7e-3, 9e-3), "rectangle"), ("slot", (3e-3, 6e-3), "rectangle"),
     ("slot", (3e-3, 6e-3), "sector"), ("chamfer", (7e-3, 9e-3), "parallel")],
)  # fmt: skip
def test_area_of_contact_follows_chamfer_and_slot(key, lengths, shape):
    """Strips between the arcs, which facets cut off by their sagitta; volume of the lining too."""
    box = "parts.pad." + key
    sweep = ", ".join(f'"{1e3 * v!r} mm"' for v in lengths)
    sets = [f"parts.pad.shape='{shape}'", f'sweep.parameters={{ "{box}"={{ values=[{sweep}] }} }}']
    scene = read_scene(VENTED, [*SETS, *PLAIN, *sets])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    strips, depth = (2, 3e-3 / 2) if key == "chamfer" else (1, 7e-3)
    usual = {"chamfer": 8e-3, "slot": 4e-3}[key]
    column = np.zeros(brake.M.shape[0])
    column[brake.elastic.free.local % 3 == 2] = 1.0
    for length in lengths:
        grown = length - usual
        # Between arcs of 96 and 140 mm strips at an end of the pad are longer.
        inner, outer = (np.sqrt(r**2 - 59e-3**2) for r in (96e-3, 140e-3))
        across = outer - inner if shape == "parallel" else 44e-3
        area = changes.contact.at({box: length}).w.sum() - brake.w.sum()
        close = 1e-9 if shape == "rectangle" else 0.05
        assert area == pytest.approx(-2 * strips * across * grown, rel=close)
        mass = column @ changes.change({box: length}, "M") @ column
        assert mass == pytest.approx(-2 * 2510 * strips * across * grown * depth, rel=close)


@pytest.mark.long
def test_contact_of_a_sample_is_that_of_nodes_moved_by_hand():
    """Rows and speeds, chamfer and slot together; the scene's own where both are as written."""
    keys = {"parts.pad.chamfer": 7.6e-3, "parts.pad.slot": 4.5e-3}
    law = ", ".join(
        f'"{k}"={{ law="uniform", min="{v - 1e-3!r} m", max="{v + 1e-3!r} m" }}'
        for k, v in keys.items()
    )
    random = f"samples={{ approaches=['multi-scale'], n=2, random={{ {law} }} }}"
    stages = "stages=['equilibrium','stability','uncertainty']"
    scene = read_scene(VENTED, [*SETS, *PLAIN, stages, random])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    assert changes.contact.at({}) is brake.contact
    found = changes.contact.at(keys)
    x = brake.mesh.domain.geometry.x
    own = np.unique(compat.geometry_dofs(brake.mesh.domain)[brake.mesh.cells_of("pad")])
    a, b = x[own, :2].T
    h = abs(x[own, 2]) - 12e-3
    side, end = np.where(a > 0, 1.0, -1.0), np.pi / 6
    # Distances from the line of the nearer end, and from mid pad.
    y = b * np.sin(end) - abs(a) * np.cos(end)
    reach = 96e-3 * np.sin(end - np.arcsin(2e-3 / 96e-3))
    inward = -0.4e-3 * np.clip((reach - y) / (reach - 8e-3), 0, 1) * np.clip(1 - h / 3e-3, 0, 1)
    edge = 96e-3 * np.sin(end - np.arcsin(8e-3 / 96e-3))
    outward = 0.25e-3 * np.interp(abs(a), [0, 2e-3, edge], [0, 1, 0])
    outward *= np.clip((10e-3 - h) / 3e-3, 0, 1)
    # Along circles: the distance from an end shrinks by sin(angle), a by the sine of another.
    step = side * (outward / b - inward / (np.cos(end) * b + np.sin(end) * abs(a)))
    x[own, 0] += step * b
    x[own, 1] -= step * a
    assert abs(brake.w - found.w).max() > 1e-3 * brake.w.max()
    exact = interface_elements(scene, "pads", brake.mesh, brake.elastic.free, MPI.COMM_SELF)
    for name in ("w", "points", "s", "speed"):
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), atol=1e-12)
    for name in "NTR":
        assert abs(getattr(found, name) - getattr(exact, name)).max() < 1e-9


@pytest.mark.slow
def test_three_lengths_of_a_pad_and_a_modulus():
    """Volume by its closed form: a lining keeps the depths of its slot and chamfers."""
    lengths = {LINING: (10e-3, 9.6e-3), CHAMFER: (3e-3, 3.4e-3), SLOT: (7e-3, 6.6e-3)}
    ranges = {**lengths, "materials.lining.C33": (2.2e9, 2.5e9)}
    law = ", ".join(
        f'"{k}"={{ law="uniform", min="{min(ends)!r} {u}", max="{max(ends)!r} {u}" }}'
        for k, ends in ranges.items()
        for u in ["m" if k in lengths else "Pa"]
    )
    random = f"samples={{ approaches=['multi-scale'], n=2, random={{ {law} }} }}"
    sets = [*SETS, *PAD, "stages=['equilibrium','stability','uncertainty']", random]
    scene = read_scene(VENTED, sets)
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    values = {key: there for key, (_, there) in lengths.items()}
    column = np.zeros(brake.M.shape[0])
    column[brake.elastic.free.local % 3 == 2] = 1.0
    outline = 2 * 118e-3 * np.sin(np.pi / 6) * 44e-3
    grown = -0.4e-3 * outline + 44e-3 * (0.4e-3 * 4e-3 - 0.4e-3 * 8e-3)
    found = column @ changes.change(values, "M") @ column
    assert found == pytest.approx(2 * 2510 * grown, rel=1e-9)
    # The stiffness of a mesh whose nodes are moved by hand.
    x = brake.mesh.domain.geometry.x
    own = np.unique(compat.geometry_dofs(brake.mesh.domain)[brake.mesh.cells_of("pad")])
    here = 12e-3 + 1e-3 * np.array([0, 3, 7, 10, 16, 16.5, 17])
    there = 12e-3 + 1e-3 * np.array([0, 3.4, 6.6, 9.6, 15.6, 16.1, 16.6])
    z = x[own, 2]
    x[own, 2] = np.sign(z) * np.interp(abs(z), here, there)
    exact = assemble_bodies(
        read_scene(VENTED, [*sets, "materials.lining.C33='2.4 GPa'"]), brake.mesh
    )
    K = brake.K + changes.change({**values, "materials.lining.C33": 2.4e9}, "K")
    assert abs(K - exact.K).max() < 1e-8 * abs(exact.K).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "ends"),
    [("parts.disc.hat", (27e-3, 33e-3)), (SLOT, (6e-3, 8e-3)), ("parts.pad.slot", (3e-3, 5e-3)),
     ("parts.pad.chamfer", (7e-3, 9e-3))],
)  # fmt: skip
def test_modes_are_those_of_a_scene_meshed_anew(key, ends):
    """At an end of the range, within the difference of two meshes: 1.5e-3 and 1e-4."""
    found = model.prepare(VENTED, SETS, parameters={key: ends}).modes({key: ends[0]})
    exact = model.prepare(VENTED, [*SETS, f"{key}='{ends[0]!r} m'"]).modes()
    np.testing.assert_allclose(found.frequency, exact.frequency, rtol=4e-3)


@pytest.mark.slow
def test_modes_of_a_slot_three_times_as_wide():
    """At full order of the same sample, in both directions from the scene."""
    key = "parts.pad.slot"
    prepared = model.prepare(VENTED, [*SETS, *PLAIN], parameters={key: (2e-3, 6e-3)})
    for width in (2e-3, 3.2e-3, 4.8e-3, 6e-3):
        exact = at_full_order(prepared, {key: width})
        assert agrees(prepared.modes({key: width}), exact, 21, 1e-5).max() < 1e-4


@pytest.mark.slow
def test_modes_of_two_lengths_of_a_pad_and_a_modulus():
    """At corners of the ranges: of scenes meshed anew; inside: of full order, within the error."""
    C33 = "materials.lining.C33"
    box = {LINING: (9e-3, 11e-3), CHAMFER: (2.5e-3, 3.5e-3), C33: (2.1e9, 2.4e9)}
    prepared = model.prepare(VENTED, SETS, parameters=box)
    for values in ({LINING: 9e-3, CHAMFER: 3.5e-3}, {LINING: 11e-3, CHAMFER: 2.5e-3, C33: 2.1e9}):
        found = prepared.modes(values)
        anew = [f"{key}='{value!r} {'Pa' if key == C33 else 'm'}'" for key, value in values.items()]
        exact = model.prepare(VENTED, [*SETS, *anew]).modes()
        np.testing.assert_allclose(found.frequency, exact.frequency, rtol=4e-3)
    values = {LINING: 10.4e-3, CHAMFER: 2.8e-3, C33: 2.3e9}
    exact = at_full_order(prepared, values)
    assert agrees(prepared.modes(values), exact, 1, 1e-5).max() < 1e-4


@pytest.mark.parametrize(
    ("sets", "key", "text"),
    [
        (["parts.disc.vanes=0"], "parts.disc.cheek", "moves no planes of it along z"),
        (["parts.pad.slot_depth='2 mm'"], CHAMFER, "moves no planes of it along z"),
        ([], "parts.disc.vane_width", "only these lengths may vary"),
        ([], "parts.disc.radius", "no edges at right angles"),
        (["parts.pad.slot=0"], "parts.pad.slot", "no edges at right angles"),
        ([], "parts.pad.plate", r"springs.pad.ears: .*lies on the sides of the layer pad.plate"),
    ],
)
def test_refusals(sets, key, text):
    """No vanes; a slot that ends within the chamfers, which would bend; a length in plane."""
    with pytest.raises(SceneError, match=text):
        model.prepare(VENTED, [*SETS, *COARSE, *sets], parameters={key: (3e-3, 4e-3)})


@pytest.mark.hard
def test_a_vane_without_height():
    """Cheeks that meet within the range: rejected with the largest that do not."""
    said = r"disc.cheek: at .* quality .* mesh holds to 1[01][.\d]* mm"
    with pytest.raises(SceneError, match=said):
        model.prepare(VENTED, [*SETS, VANES], parameters={"parts.disc.cheek": (8e-3, 12e-3)})
