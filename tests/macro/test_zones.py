"""Interfaces on parts of a face: laws of their own, what belongs to none, and mistakes."""

import csv
import re

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.interfaces import in_zone
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.braking import equilibrium
from brake_fenicsx.micro import linear_law
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.contact_section import Zone
from places import BLOCK

FEW = ["mesh.cells=hexahedra", "parts.block.size='7 mm'", "parts.plate.size='14 mm'"]
INNER, OUTER = '{ radius = [0, "12 mm"] }', '{ radius = ["12 mm", "1 m"] }'


def interface(name, law, zone=None, more=""):
    """An interface of block and plate as a replacement."""
    zone = "" if zone is None else f", zone = {zone}"
    faces = 'faces = ["block.bottom", "plate.top"]'
    return f"contact.{name}={{ {faces}, friction = 0.5, law = {law}{zone}{more} }}"


def only(*interfaces):
    """Coarse cells, and these interfaces alone."""
    return [*FEW, "contact={}", *interfaces]


def test_points_in_a_zone():
    """Ranges hold their low end; an angle counts by whole turns."""
    degrees = np.radians([0.0, 90.0, -175.0, 175.0, -90.0])
    points = np.stack([np.cos(degrees), np.sin(degrees), [0.0, 1.0, 2.0, 3.0, 4.0]], axis=1)

    def found(**ranges):
        return in_zone(Zone(**ranges), points).tolist()

    assert found(angle=(np.radians(170), np.radians(190))) == [False, False, True, True, False]
    assert found(angle=(-np.pi / 4, np.pi / 4)) == [True, False, False, False, False]
    assert found(angle=(-np.pi, np.pi)) == [True] * 5
    assert found(z=(1.0, 3.0)) == [False, True, True, False, False]
    assert found(z=(1.0, 3.0), y=(0.0, 2.0)) == [False, True, False, False, False]
    assert found(radius=(0.0, 0.9)) == [False] * 5
    # Round-off beside the border of two zones: each point belongs to one of them.
    at = np.array([[1.0, -1e-17, 0.0], [1.0, 0.0, 0.0], [1.0, 1e-17, 0.0]])
    quarters = [in_zone(Zone(angle=(k * np.pi / 2, (k + 1) * np.pi / 2)), at) for k in range(4)]
    assert np.sum(quarters, axis=0).tolist() == [1, 1, 1]


def test_two_zones_with_one_law_are_one_interface(tmp_path):
    """Areas, pressures and modes of the block are those of the whole face."""
    law, out = '{ p0 = "10 MPa", u0 = "10 um" }', {}
    for name, changes in {
        "one": only(interface("whole", law)),
        "two": only(interface("ring", law, OUTER), interface("core", law, INNER)),
    }.items():
        done = run(BLOCK, MPI.COMM_SELF, tmp_path / name, [*changes, "stages=['equilibrium',"
                   "'stability']", "stability.band=['0 Hz','20 kHz']"])  # fmt: skip
        files = ("modes.csv", "contact.csv")
        rows = [list(csv.DictReader((tmp_path / name / f).open())) for f in files]
        modes = np.array([[float(r["frequency_hz"]), float(r["real_1_s"])] for r in rows[0]])
        keys = ("x", "y", "area", "p")
        elements = np.array([[float(r[k]) for k in keys] for r in rows[1]])
        order = np.lexsort(np.rint(1e6 * elements[:, :2]).T)
        out[name] = modes, elements[order], done.facts["uncovered_area_mm2"]
    assert len(out["one"][0]) >= 4
    np.testing.assert_allclose(out["two"][0], out["one"][0], rtol=1e-7, atol=1e-3)
    np.testing.assert_allclose(out["two"][1], out["one"][1], rtol=1e-7, atol=1e-12)
    assert abs(out["two"][2]) < 1e-9


def test_two_penalties_under_a_rigid_block(comm):
    """In parallel: every element sinks by F / (k_1 A_1 + k_2 A_2)."""
    k = 2e10, 5e9
    linear = [f'{{ linear = "{v} Pa/m" }}' for v in k]
    stiff = [
        f"materials.{name}={{ model = 'isotropic', E = '1e7 GPa', nu = 0, rho = '1 g/cm^3' }}"
        for name in ("iron", "lining")
    ]
    changes = only(interface("core", linear[0], INNER), interface("ring", linear[1], OUTER))
    upright = "supports.\"block.sides\"=['x', 'y']"
    brake = assemble(BLOCK, comm, [*changes, *stiff, upright])
    of = brake.contact.interface
    area = [brake.w[of == i].sum() for i in (0, 1)]
    assert min(area) > 1e-4 and sum(area) == pytest.approx(800e-6, rel=1e-12)
    eq = equilibrium(brake, [linear_law(v) for v in k], 0.0, 0.0, of, comm=comm)
    sunk = 5e5 * 800e-6 / np.dot(k, area)
    np.testing.assert_allclose(eq.g, -sunk, rtol=1e-5)
    np.testing.assert_allclose(eq.p, np.array(k)[of] * sunk, rtol=1e-5)


def test_area_of_no_interface_is_counted_once(comm):
    """One zone: the rest of the face; two: what neither of them covers."""
    law = '{ linear = "1e12 Pa/m" }'
    for zones, left in (
        ((INNER,), 800e-6),
        ((INNER, '{ x = ["10 mm", "20 mm"], radius = ["12 mm", "1 m"] }'), 800e-6),
    ):
        names = [interface(f"zone{i}", law, zone) for i, zone in enumerate(zones)]
        brake = assemble(BLOCK, comm, only(*names))
        covered = brake.w.sum()
        assert 0.1 * left < covered < 0.9 * left
        assert brake.contact.uncovered == pytest.approx(left - covered, rel=1e-10)
        assert np.unique(brake.contact.interface).size == len(zones)


LAW = '{ linear = "1e12 Pa/m" }'
WRONG = [
    ("{}", "contact.a.zone: no range; write some of radius, angle, x, y, z"),
    ('{ radius = ["9 mm"] }', "contact.a.zone.radius = ['9 mm']: write [lowest, highest]"),
    ('{ x = ["2 mm", "1 mm"] }', "contact.a.zone.x = ['2 mm', '1 mm']: write [lowest, highest]"),
    ('{ angle = [0, "1 mm"] }', "contact.a.zone.angle = [0, '1 mm']: wrong unit; a angle [deg]"),
    (
        '{ angle = [0, "400 deg"] }',
        "contact.a.zone.angle = ['0 deg', '400 deg']: more than a whole turn",
    ),
    ('{ radius = ["-1 mm", "1 mm"] }', "contact.a.zone.radius = ['-1 mm', '1 mm']: must be zero"),
    ('{ raduis = [0, "1 mm"] }', "contact.a.zone.raduis = [0, '1 mm']: unknown key; did you mean"),
]


@pytest.mark.parametrize(("zone", "said"), WRONG)
def test_wrong_zones(zone, said):
    with pytest.raises(SceneError, match=re.escape(said)) as error:
        read_scene(BLOCK, only(interface("a", LAW, zone)))
    assert str(BLOCK) in str(error.value)


@pytest.mark.parametrize(
    ("interfaces", "said"),
    [
        (
            [interface("a", LAW, '{ radius = ["80 mm", "90 mm"], z = ["-1 mm", "1 mm"] }')],
            r"contact.a.zone: contains no centre of a contact element; they lie at radius [\d.]+ mm"
            r" to [\d.]+ mm, z 0 mm to 0 mm; widen the zone",
        ),
        (
            [interface("a", LAW), interface("b", LAW, INNER)],
            r"contact.a.zone, contact.b.zone: \d+ contact elements of 'block.bottom' and"
            r" 'plate.top' belong to both; write zones",
        ),
        (
            [interface("a", LAW, INNER), interface("b", LAW, OUTER, ', discretisation = "node"')],
            "contact.b.discretisation = 'node': contact.a is on the same faces with 'patch'; write"
            " the same",
        ),
    ],
)
def test_zones_that_do_not_fit_the_face(interfaces, said):
    with pytest.raises(SceneError, match=said) as error:
        assemble(BLOCK, MPI.COMM_SELF, only(*interfaces))
    assert str(BLOCK) in str(error.value)
