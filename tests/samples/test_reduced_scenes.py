"""Scenes drawn at random from all keys that add to matrices: full order against the reduced model.

One part names two pads, on both sides of a small disc; a block is tied to one of them or joined by
springs, and a body given by its matrices hangs beside. What couples bodies in silence, or lies
outside of the substructures, is lost by the reduced model alone.
"""

from itertools import combinations

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import example, given, settings
from hypothesis import strategies as st

from brake_fenicsx import model
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.faces import faces_of_bodies, gather_face
from brake_fenicsx.macro.integrals import facet_areas
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import split_substructures
from full_order import agrees, at_full_order

BRAKE = """
stages = ["equilibrium", "stability"]

[parts.disc]
builder = "disc"
radius = "60 mm"
bore = "25 mm"
thickness = "10 mm"
size = "60 mm"
material = "iron"

[parts.pad]
builder = "pad"
side = "both"
z = "5 mm"
r_inner = "30 mm"
r_outer = "55 mm"
angle = "60 deg"
lining = "8 mm"
plate = "6 mm"
ear_length = "0 mm"
piston_diameter = "18 mm"
size = "40 mm"
plate_size = "40 mm"
material = { lining = "lining", plate = "iron" }

[parts.cap]
builder = "block"
length = "110 mm"
width = "110 mm"
height = "9 mm"
z = "19 mm"
size = "110 mm"
material = "iron"

[parts.arm.matrices]
stiffness = "K.npz"
mass = "M.npz"
damping = "C.npz"
nodes = "nodes.csv"
units = ["m", "kg", "s"]

[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"

[materials.lining]
model = "isotropic"
E = "4 GPa"
nu = 0.3
rho = "2510 kg/m^3"

[contact.pads]
faces = ["pad.friction", "disc.friction"]
law = { p0 = "10 MPa", u0 = "10 um" }
friction = 0.5

[contact.pads.zone]
angle = ["0 deg", "90 deg"]

[contact.rest]
faces = ["pad.friction", "disc.friction"]
law = { linear = "1e12 Pa/m" }
friction = { static = 0.6, kinetic = 0.4, decay = "2 m/s" }

[contact.rest.zone]
angle = ["90 deg", "360 deg"]

[supports]
"disc.bore" = "clamped"

[loads]
"pad.piston" = { pressure = "5 bar" }

[springs]
"pad.piston" = { stiffness = ["5 kN/mm", "4 kN/mm", "3 kN/mm"] }
"cap.top" = { stiffness = ["6 kN/mm", "7 kN/mm", "9 kN/mm"] }
"arm.foot" = { stiffness = ["2 kN/mm", "3 kN/mm", "2 kN/mm"] }

[motion]
axis = "z"
speed = "20 rad/s"

[stability]
band = ["0 Hz", "9 kHz"]
method = "reduced"
"""


def three(unit, *values):
    """Three values as TOML."""
    return "[" + ", ".join(f"'{v} {unit}'" for v in values) + "]"


INERTIA = (300e-6, 200e-6, 400e-6)
CLIPS = [("pad.piston", "cap.bottom"), ("cap.top", "arm.end"), ("pad.piston", "disc.friction")]
CHOICES = {
    "clip": st.sampled_from([None, *CLIPS]),
    "clip_damping": st.booleans(),
    "dashpots": st.booleans(),
    "bedding": st.booleans(),
    "mass": st.sampled_from([None, "mass", "inertia"]),
    "inertia_of_cap": st.booleans(),
    "tie": st.sampled_from([None, "cap", "arm"]),
    "held": st.sampled_from([None, "cap.top", "arm.end"]),
    "stuck": st.booleans(),
    "force": st.booleans(),
    "rayleigh": st.booleans(),
    "loss": st.booleans(),
    "sliding": st.booleans(),
    "slope": st.booleans(),
    "gyroscopic": st.booleans(),
    "turns": st.booleans(),
}


def changes(c):
    """Changes of the scene that a draw stands for."""
    out, damping = [], []
    if c["clip"]:
        more = f", damping={three('N s/m', 30, 20, 40)}" if c["clip_damping"] else ""
        out.append(
            f"springs.clip={{ faces={list(c['clip'])}, stiffness={three('kN/mm', 8, 5, 9)}{more} }}"
        )
    if c["dashpots"]:
        out.append(f'springs."pad.piston".damping={three("N s/m", 30, 20, 40)}')
    if c["bedding"]:
        out.append(f'springs."cap.top".stiffness_per_area={three("Pa/m", 1e8, 2e8, 1e9)}')
    inertia = three("kg m^2", *INERTIA)
    masses = {}
    if c["mass"]:
        more = f", inertia={inertia}" if c["mass"] == "inertia" else ""
        masses["pad.piston"] = f"{{ mass='0.3 kg'{more} }}"
    if c["inertia_of_cap"]:
        masses["cap.top"] = f"{{ mass='0.1 kg', inertia={inertia} }}"
    if masses:
        out.append("masses={ " + ", ".join(f'"{k}"={v}' for k, v in masses.items()) + " }")
    if c["tie"] == "cap":
        out.append('ties={ glue={ faces=["pad.piston", "cap.bottom"] } }')
    if c["tie"] == "arm":
        out.append('ties={ glue={ faces=["arm.foot", "cap.top"] } }')
    if c["held"] and not (c["held"] == "cap.top" and c["tie"] == "arm"):
        out.append(f"supports.\"{c['held']}\"=['x', 'y']")
    if c["stuck"]:
        out += ["contact.rest.slip='stuck'", "contact.rest.tangential_stiffness='3e11 Pa/m'"]
        out.append("contact.rest.friction=0.0")
    if c["force"]:
        out.append("loads.\"cap.top\"={ force=['10 N', '20 N', '-90 N'] }")
    if not c["turns"]:
        out.append("motion={ direction=[1, 0.2, 0], speed='1 m/s' }")
    if c["rayleigh"]:
        damping.append("rayleigh=['200 1/s', '0.1 us']")
    if c["loss"]:
        damping += ["loss=true", "omega_ref='4 kHz'"]
        out += ["materials.iron.loss=0.002", "materials.lining.loss=0.03"]
    if c["sliding"]:
        damping.append("sliding=true")
    if c["slope"] and not c["stuck"]:
        damping.append("slope=true")
    if c["gyroscopic"] and c["turns"] and not masses and not c["stuck"]:
        damping.append("gyroscopic=true")
    if damping:
        out.append(f"stability.damping={{ {', '.join(damping)} }}")
    return out


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The scene with the matrices of the arm: four nodes, a spring between each two of them."""
    folder = tmp_path_factory.mktemp("brake")
    x = np.array([[0.0, 0, 28], [20, 0, 28], [0, 25, 28], [5, 8, 60]]) * 1e-3
    K = np.zeros((12, 12))
    for i, j in combinations(range(4), 2):
        row = np.zeros(12)
        row[3 * i : 3 * i + 3] = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
        row[3 * j : 3 * j + 3] = -row[3 * i : 3 * i + 3]
        K += 2e7 * np.outer(row, row)
    for name, A in {"K": K, "M": 0.05 * np.eye(12), "C": 1e-6 * K}.items():
        sp.save_npz(folder / f"{name}.npz", sp.csr_matrix(A))
    sets = ["foot", "foot", "foot", "end"]
    rows = [
        f"{i},{a},{b},{c},{one}"
        for i, ((a, b, c), one) in enumerate(zip(x.tolist(), sets, strict=True))
    ]
    (folder / "nodes.csv").write_text("\n".join(["node,x,y,z,sets", *rows]) + "\n")
    (folder / "brake.toml").write_text(BRAKE)
    return folder / "brake.toml"


def compared(scene, chosen):
    """Modes of a scene by the reduced model, each within its stated error of full order."""
    prepared = model.prepare(scene, changes(chosen), parameters={"contact.pads.friction": (0, 1)})
    assert prepared.study.models.reduction.by_reduction == {"multi-scale": True}
    agrees(prepared.modes(), at_full_order(prepared))


NOTHING = dict.fromkeys(CHOICES)


# Damping in proportion couples no mode of the cap: what its polynomial has is round-off, of 1e-9.
@pytest.mark.long
@example(chosen={**NOTHING, "loss": True})
@settings(max_examples=4, deadline=None)
@given(chosen=st.fixed_dictionaries(CHOICES))
def test_reduced_model_is_full_order(scene, chosen):
    compared(scene, chosen)


@pytest.mark.parametrize("matrix", ["K", "M", "C", "change"])
def test_each_matrix_couples_bodies(matrix):
    """A matrix that joins two dofs makes one body of them."""
    apart, joined = sp.identity(2, format="csr"), sp.csr_matrix([[2.0, 1.0], [1.0, 2.0]])
    A = {name: joined if name == matrix else apart for name in ("K", "M", "C", "change")}
    given = A["K"], A["M"], {"N": apart}, None, [A["change"]], A["C"]
    assert len(split_substructures(*given)) == 1


def test_springs_between_faces_of_two_bodies_each_are_refused(scene):
    clip = "springs.clip={ faces=['pad.piston', 'pad.friction'], stiffness=['1 N/m', 0, 0] }"
    with pytest.raises(SceneError, match=r"springs.clip: faces = .*2 bodies .* part of its own"):
        assemble_brake(read_scene(scene, [clip]), MPI.COMM_SELF)


def test_inertia_on_two_pads(scene):
    """Each pad has its share about its own centroid, and nothing but contact couples them."""
    plain = assemble_brake(read_scene(scene, changes({**NOTHING, "mass": "mass"})), MPI.COMM_SELF)
    brake = assemble_brake(
        read_scene(scene, changes({**NOTHING, "mass": "inertia"})), MPI.COMM_SELF
    )
    free, added = brake.elastic.free, brake.M - plain.M
    x = dof_points(brake)
    piston = gather_face(brake.mesh, free, "pad.piston")
    for face in faces_of_bodies(free, piston):
        area = facet_areas(face)
        centre = area @ face.centre / area.sum()
        # The axes 1 and 2 of the part are -x and -y.
        for value, axis in zip(INERTIA, ([-1, 0, 0], [0, -1, 0], [0, 0, 1]), strict=True):
            turning = np.cross(axis, x[:, :3] - centre)
            u = np.zeros(len(x))
            own = (x[:, 3] < 3) & (np.sign(x[:, 2]) == np.sign(centre[2]))
            own &= (np.abs(x[:, 2]) > 5e-3 - 1e-9) & (np.abs(x[:, 2]) < 19e-3 + 1e-9)
            u[own] = turning[own, x[own, 3].astype(int)]
            assert u @ added @ u == pytest.approx(value / 2, rel=1e-6)
    compared(scene, {**NOTHING, "mass": "inertia"})
    bodies = split_substructures(brake.K, brake.M, {n: getattr(brake, n) for n in "NTR"})
    assert len(bodies) == 5
