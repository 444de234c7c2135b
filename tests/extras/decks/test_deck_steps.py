"""Steps and options of a deck of Abaqus or CalculiX: what of them a first scene has.

What is right is the meaning of the keyword in the Abaqus Keywords Reference Guide and in the
CalculiX CrunchiX user's manual; forces are sums by hand.
"""

import re

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.draft.deck import _READERS
from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.extras.decks.keywords import HARMLESS, KNOWN
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.scene import read_scene
from small_decks import HELD, INTERACTION, MATERIALS, MESH, MODES, PAIR, deck

STEP = "*STEP\n*STATIC\n{}*END STEP\n"


@pytest.fixture
def drafted(tmp_path):
    """Write a deck: its scene, and the lines on what is not taken over."""

    def draft(**parts):
        file, scene = tmp_path / "brake.inp", tmp_path / "brake.toml"
        file.write_text(deck(**parts))
        scene.unlink(missing_ok=True)
        write_scene(file, scene)
        text = scene.read_text()
        lost = re.findall("# not taken over: (.*)", text)
        lines = file.read_text().splitlines()
        named = re.compile(r"(.*) \(brake.inp:(\d+)")
        for said, at in (pair for line in lost for pair in named.findall(line)):
            assert lines[int(at) - 1].startswith(said)
        return read_scene(scene), lost

    return draft


def test_the_plain_deck(drafted):
    """Every value by hand, no remark; the band is that of the modes and not 5 kHz."""
    scene, lost = drafted()
    (contact,) = scene.contact.values()
    assert not lost and contact.friction == 0.4 and contact.law.linear == pytest.approx(2e13)
    assert scene.supports == {"plate.bottom": ("x", "y", "z"), "block.top": ("x", "y")}
    assert scene.loads["block.top"].pressure == pytest.approx(0.5e6)
    assert scene.stability.band == (0.0, 12e3)
    text = scene.file.read_text()
    at = 1 + deck().splitlines().index("*COMPLEX FREQUENCY")
    assert f"# The scene is of step 2 of 2 (*COMPLEX FREQUENCY, brake.inp:{at}).\n" in text


def test_check_is_silent_about_what_the_scene_holds(drafted, capsys):
    """Not so once the scene has lost a support."""
    held = HELD.replace("TOP, 1, 2", "TOP, 1, 2\nSIDE, 1")
    assert main(["check", str(drafted(held=held)[0].file)]) == 0
    said = "".join(capsys.readouterr())
    assert "brake: 10 cells" in said and "not read" not in said and "not in the scene" not in said
    for name, along in (("block.side", '["x"]'), ("block.top", '["x", "y"]')):
        path = drafted(held=held)[0].file
        path.write_text(path.read_text().replace(f'"{name}" = {along}\n', ""))
        main(["check", str(path)])
        word = name.partition(".")[2].upper()
        assert f"[supports] {word}" in "".join(capsys.readouterr())


LATER = {
    "a support that is removed": (
        {"held": HELD + "*BOUNDARY\nSIDE, 1, 3\n",
         "after": STEP.format("*BOUNDARY, OP=NEW\nBOTTOM, 1, 3\nTOP, 1, 2\n")},
        lambda s: s.supports == {"plate.bottom": ("x", "y", "z"), "block.top": ("x", "y")},
    ),
    "a support that is added": (
        {"after": STEP.format("*BOUNDARY\nTOP, 3\n")},
        lambda s: s.supports["block.top"] == ("x", "y", "z"),
    ),
    "a removed force, nine nodes of 1 N": (
        {"pressed": STEP.format("*CLOAD\nTOP, 3, -20.\n"),
         "after": STEP.format("*CLOAD, OP=NEW\nTOP, 1, 1.\n")},
        lambda s: s.loads["block.top"].force == pytest.approx((9.0, 0.0, 0.0)),
    ),
    "a force of another component stays": (
        {"pressed": STEP.format("*CLOAD\nTOP, 3, -20.\n"),
         "after": STEP.format("*CLOAD\nTOP, 1, 1.\n*CLOAD, OP=MOD\nTOP, 2, 2.\n")},
        lambda s: s.loads["block.top"].force == pytest.approx((9.0, 18.0, -180.0)),
    ),
    "a pressure that is removed": (
        {"after": STEP.format("*DSLOAD, OP=NEW\nPAD, P, 0.0\n*CLOAD\nTOP, 3, -5.\n")},
        lambda s: (s.loads["block.top"].pressure, s.loads["block.top"].force[2])
        == (None, pytest.approx(-45.0)),
    ),
    "a pressure that is raised": (
        {"after": STEP.format("*DSLOAD\nBACK, P, 0.75\n")},
        lambda s: s.loads["block.top"].pressure == pytest.approx(0.75e6),
    ),
    "a lowered friction": (
        {"after": STEP.format("*CHANGE FRICTION, INTERACTION=RUBS\n*FRICTION\n0.1\n")},
        lambda s: s.contact["block_plate"].friction == 0.1,
    ),
    "a removed pair": (
        {"after": STEP.format("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\nPAD, DISC\n")},
        lambda s: not s.contact,
    ),
    "a pair that comes back": (
        {"after": STEP.format("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\nPAD, DISC\n")
         + STEP.format("*MODEL CHANGE, TYPE=CONTACT PAIR, ADD\nPAD, DISC\n")},
        lambda s: s.contact["block_plate"].friction == 0.4,
    ),
    "half a pressure at the end of its amplitude": (
        {"pressed": "*AMPLITUDE, NAME=RAMP\n0., 0., 1., 0.5\n"
         + STEP.format("*DSLOAD, AMPLITUDE=RAMP\nBACK, P, 0.5\n")},
        lambda s: s.loads["block.top"].pressure == pytest.approx(0.25e6),
    ),
    "an amplitude over the time of two steps: 0.75 at 1.5": (
        {"before": "*AMPLITUDE, NAME=RAMP, TIME=TOTAL TIME\n0., 0., 2., 1.\n",
         "pressed": STEP.format("") + "*STEP\n*STATIC\n0.1, 0.5\n"
         "*DSLOAD, AMPLITUDE=ramp\nBACK, P, 1.\n*END STEP\n"},
        lambda s: s.loads["block.top"].pressure == pytest.approx(0.75e6),
    ),
    "the band of the real modes before complex ones without one": (
        {"modes": "*STEP\n*FREQUENCY\n30, 100., 7000.\n*END STEP\n*STEP\n*COMPLEX FREQUENCY\n10\n"
         "*END STEP\n"},
        lambda s: s.stability.band == (100.0, 7e3),
    ),
    "another case of letters, no blanks in names, lines that go on": (
        {"after": "*Step\n*Static\n*change friction,\ninteraction=rubs\n*Friction\n.2\n*Endstep\n"},
        lambda s: s.contact["block_plate"].friction == 0.2,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LATER)
def test_the_last_step_before_the_modes_counts(name, drafted):
    """OP=NEW, OP=MOD, *CHANGE FRICTION, *MODEL CHANGE and amplitudes, without a remark."""
    parts, right = LATER[name]
    scene, lost = drafted(**parts)
    assert right(scene), scene.file.read_text()
    assert not lost


LEFT = {
    "steps behind the modes": (
        {"modes": MODES + STEP.format("*CLOAD\nTOP, 3, -9.\n")},
        "*STEP (brake.inp:{}): it comes after", lambda s: s.loads["block.top"].force is None,
    ),
    "a load in the step of the modes": (
        {"modes": MODES.replace("*COMPLEX", "*CLOAD\nTOP, 3, -9.\n*COMPLEX")},
        "*CLOAD (brake.inp:{}): it stands in the step of the modes",
        lambda s: s.loads["block.top"].force is None,
    ),
    "a support of the modes alone": (
        {"modes": MODES.replace("*COMPLEX", "*BOUNDARY\nTOP, 3\n*COMPLEX")},
        "*BOUNDARY (brake.inp:{}): it changes supports for the modes",
        lambda s: s.supports["block.top"] == ("x", "y", "z"),
    ),
    "a static perturbation": (
        {"after": "*STEP, PERTURBATION\n*STATIC\n*CLOAD\nTOP, 3, -9.\n*END STEP\n"},
        "*STEP, PERTURBATION (brake.inp:{}): it is about the state",
        lambda s: s.loads["block.top"].force is None,
    ),
    "stress stiffness": (
        {"modes": MODES.replace("*STEP", "*STEP, PERTURBATION")},
        "PERTURBATION: the stiffness by the stresses", lambda s: s.loads["block.top"].pressure,
    ),
    "a load twice in one step": (
        {"pressed": STEP.format("*CLOAD\nTOP, 3, -1.\nTOP, 3, -2.\n")},
        "TOP, 3, -2.: it stands twice", lambda s: not s.loads,
    ),
    "an amplitude that is not understood": (
        {"pressed": "*AMPLITUDE, NAME=A, DEFINITION=PERIODIC\n1, 2., 0., 1.\n0., 1.\n"
         + STEP.format("*DSLOAD, AMPLITUDE=A\nBACK, P, 0.5\n")},
        "its amplitude A: DEFINITION = PERIODIC is not", lambda s: not s.loads,
    ),
    "an amplitude that is not there": (
        {"pressed": STEP.format("*DSLOAD, AMPLITUDE=A\nBACK, P, 0.5\n")},
        "its amplitude A: is not there", lambda s: not s.loads,
    ),
    "a friction over the slip rate": (
        {"interaction": INTERACTION.replace("0.4\n", "0.5, 0.\n0.2, 1000.\n")},
        "*FRICTION (brake.inp:{}): 2 data lines are not understood",
        lambda s: "# proposed: friction" in s.file.read_text(),
    ),
    "a tension of faces apart, after the stiffness of contact in CalculiX 2.20": (
        {"interaction": INTERACTION.replace("2.E4", "20., 3., 0.001")},
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR (brake.inp:{}): its first number is taken",
        lambda s: s.contact["block_plate"].law.linear == pytest.approx(2e10),
    ),
    "a table of temperatures": (
        {"materials": MATERIALS.replace("2000., 0.3\n", "2000., 0.3, 20.\n1500., 0.3, 200.\n")},
        "*ELASTIC (brake.inp:{}): 6 numbers",
        None,
    ),
    "a gravity": (
        {"pressed": STEP.format("*DLOAD\nBLOCK, GRAV, 9810., 0., 0., -1.\n")},
        "BLOCK, GRAV, 9810., 0., 0., -1.: no pressure on a face", lambda s: not s.loads,
    ),
    "a pressure that CalculiX 2.20 removes as well, Abaqus not": (
        {"after": STEP.format("*DLOAD, OP=NEW\n")},
        "*DLOAD, OP=NEW (brake.inp:{}): CalculiX removes *DSLOAD too",
        lambda s: s.loads["block.top"].pressure == pytest.approx(0.5e6),
    ),
    "a displacement": (
        {"after": STEP.format("*BOUNDARY\nTOP, 3, 3, -0.1\n")},
        "*BOUNDARY (brake.inp:{}): it moves its nodes",
        lambda s: s.supports["block.top"] == ("x", "y", "z"),
    ),
    "friction damping": (
        {"modes": MODES.replace("FREQUENCY", "FREQUENCY, FRICTION DAMPING=YES")},
        "FRICTIONDAMPING = YES: write stability.damping.sliding", lambda s: not s.damping,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LEFT)
def test_what_a_scene_cannot_hold_has_its_line(name, drafted):
    """Named with its line, and left out: nothing is approximated by half of it."""
    parts, said, right = LEFT[name]
    if right is None:
        with pytest.raises(SceneError, match=r"no \[materials.LINING\]"):
            drafted(**parts)
        return
    scene, lost = drafted(**parts)
    plain = [re.sub(r":\d+\)", ":{})", line) for line in lost]
    assert any(said in line for line in plain), lost
    assert right(scene), scene.file.read_text()


def test_friction_that_falls_exponentially(drafted):
    """0.5 to 0.2 with 0.003 s/mm: 0.2 + 0.3 exp(-3) = 0.214936 at 1 m/s."""
    own = INTERACTION.replace("*FRICTION\n0.4", "*FRICTION, EXPONENTIAL DECAY\n0.5, 0.2, 0.003")
    scene, lost = drafted(interaction=own)
    mu, _ = scene.contact["block_plate"].friction.coefficient(np.array([0.0, 1.0]))
    np.testing.assert_allclose(mu, [0.5, 0.2 + 0.3 * np.exp(-3.0)], rtol=1e-5)
    assert not lost
    _, lost = drafted(interaction=own.replace("0.003", "0."))
    assert "a decay constant of 0" in lost[0] and len(lost) == 1


def test_rough_faces_stick(drafted):
    scene, lost = drafted(interaction=INTERACTION.replace("*FRICTION\n0.4", "*FRICTION, ROUGH"))
    assert scene.contact["block_plate"].slip == "stuck" and not lost


@pytest.mark.parametrize("how", ["pair", "overclosure"])
def test_tied_contact_is_a_tie(how, drafted):
    """TIED of Abaqus; PRESSURE-OVERCLOSURE=TIED of CalculiX, whose stiffness has its line."""
    parts = {"pair": PAIR.replace("RUBS,", "RUBS, TIED,")}
    if how == "overclosure":
        parts = {"interaction": INTERACTION.replace("LINEAR", "TIED").replace("0.4", "0.4, 2.E4")}
    scene, lost = drafted(**parts)
    (tie,) = scene.ties.values()
    assert {*tie.faces} == {"block.pad", "plate.disc"} and not scene.contact
    assert [line for line in lost if "write the stiffness of the tie" in line] == lost
    assert len(lost) == (how == "overclosure")


TURNED = "*TRANSFORM, NSET=TOP, TYPE=R\n{}\n"


@pytest.mark.parametrize(
    ("axes", "held", "along", "force"),
    [
        ("0., 1., 0., -1., 0., 0.", "TOP, 1", ("y",), (-18.0, 9.0, 0.0)),
        ("0., 1., 0., -1., 0., 0.", "TOP, 1, 3", ("x", "y", "z"), (-18.0, 9.0, 0.0)),
        ("1., 1., 0., -1., 1., 0.", "TOP, 1, 3", ("x", "y", "z"), None),
        ("1., 1., 0., -1., 1., 0.", "TOP, 3", ("z",), None),
        ("1., 1., 0., -1., 1., 0.", "TOP, 1", None, None),
    ],
)
def test_axes_of_nodes(axes, held, along, force, drafted):
    """1 N along the local 1 and 2 N along 2 of nine nodes; what is not along x, y, z is said.

    A quarter turn about z takes 1 to y and 2 to -x; 45 degrees leave the plane, but not all three.
    """
    scene, lost = drafted(
        before=TURNED.format(axes),
        held=f"*BOUNDARY\nBOTTOM, 1, 3\n{held}\n",
        pressed=STEP.format("*CLOAD\nTOP, 1, 1.\nTOP, 2, 2.\n"),
    )
    assert scene.supports.get("block.top") == along
    assert (scene.loads["block.top"].force if scene.loads else None) == (
        pytest.approx(force) if force else None
    )
    assert len(lost) == 2 * (force is None) + (along is None)
    assert all("along axes of its nodes" in line for line in lost)


def test_cylindrical_axes_of_nodes_are_left_out(drafted):
    scene, lost = drafted(before="*TRANSFORM, NSET=TOP, TYPE=C\n0, 0, 0, 0, 0, 1\n")
    assert "block.top" not in scene.supports and len(lost) == 2


QUADRATIC = """*NODE
1, 0., 0., 0.\n2, 20., 0., 0.\n3, 20., 20., 0.\n4, 0., 20., 0.
5, 0., 0., 20.\n6, 20., 0., 20.\n7, 20., 20., 20.\n8, 0., 20., 20.
9, 10., 0., 0.\n10, 20., 10., 0.\n11, 10., 20., 0.\n12, 0., 10., 0.
13, 10., 0., 20.\n14, 20., 10., 20.\n15, 10., 20., 20.\n16, 0., 10., 20.
17, 0., 0., 10.\n18, 20., 0., 10.\n19, 20., 20., 10.\n20, 0., 20., 10.
*ELEMENT, TYPE=C3D20, ELSET=BLOCK
1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14,
15, 16, 17, 18, 19, 20
*MATERIAL, NAME=IRON
*ELASTIC
125000., 0.24
*DENSITY
7.2e-9
*SOLID SECTION, ELSET=BLOCK, MATERIAL=IRON
*BOUNDARY
LOW, 1, 3
*NSET, NSET=LOW
"""


@pytest.mark.parametrize(("nodes", "left"), [("", 0), (", 5", 1), (", 13, 17", 2), (", 1, 1", 0)])
def test_nodes_of_a_set_on_no_whole_facet(nodes, left, tmp_path):
    """Corners and middle nodes beside the lower face, which are held in the deck alone: a line."""
    (tmp_path / "deck.inp").write_text(f"{QUADRATIC}1, 2, 3, 4, 9, 10, 11, 12{nodes}\n")
    write_scene(tmp_path / "deck.inp", tmp_path / "deck.toml")
    assert read_scene(tmp_path / "deck.toml").supports == {"block.low": ("x", "y", "z")}
    said = [
        line for line in (tmp_path / "deck.toml").read_text().splitlines() if "no whole" in line
    ]
    words = f'"LOW": {left} node{"s" * (left > 1)} on no whole facet of it'
    assert said == [f"# not taken over: {words}"] * (left > 0)


AWAY = "*NODE, NSET=REF\n999, 30., 15., 30.\n*COUPLING, REF NODE=999, SURFACE=BACK\n"
LUMPED = "*ELEMENT, TYPE=MASS, ELSET=L\n9999, 999\n*MASS, ELSET=L\n1e-5\n"


def test_reference_nodes_away_from_their_faces(drafted):
    """10 mm above the middle of BACK: 7 N along x are 0.07 N m about y too, beside the 0.02 N m of
    the deck, as the reactions of CalculiX 2.20 are. A face that is rigid in the deck is named, also
    where nothing acts on it, and not where it is clamped."""
    force = STEP.format("*CLOAD\n999, 1, 7.\n999, 5, 20.\n")
    for kind, said in (("*DISTRIBUTING\n", []), ("*KINEMATIC\n1, 3\n", ["BACK is not rigid"])):
        scene, lost = drafted(before=AWAY + kind, pressed=force)
        load = scene.loads["block.back" if "block.back" in scene.loads else "block.top"]
        assert pytest.approx((7.0, 0.0, 0.0)) == load.force
        assert pytest.approx((0.0, 0.09, 0.0)) == load.moment
        assert [word in line for word, line in zip(said, lost, strict=True)] == [True] * len(said)
    _, (line,) = drafted(before=AWAY + "*DISTRIBUTING\n" + LUMPED)
    assert "its node is away from the middle of block." in line
    _, (line,) = drafted(before=REF + "*RIGID BODY, REF NODE=REF, NSET=TOP\n")
    assert "TOP is not rigid" in line


def test_held_reference_nodes(drafted):
    """*KINEMATIC holds each point, without data lines too (Abaqus; CalculiX 2.20 couples nothing).
    *DISTRIBUTING holds the mean motion alone (Abaqus), or nothing (CalculiX 2.20): it is said."""
    held = "*BOUNDARY\nBOTTOM, 1, 3\nREF, 1, 6\n"
    for kind, node in (("*KINEMATIC\n", "REF"), ("*KINEMATIC\n1, 3\n", "999")):
        scene, lost = drafted(before=AWAY + kind, held=held.replace("REF", node), pressed="")
        assert ("x", "y", "z") in [scene.supports.get(f"block.{n}") for n in ("back", "top")]
        assert not lost
    scene, (line,) = drafted(before=AWAY + "*DISTRIBUTING\n", held=held)
    assert "node REF does not hold all points of BACK" in line
    assert [*scene.supports] == ["plate.bottom"]


GENERAL = """*CONTACT
*CONTACT INCLUSIONS, ALL EXTERIOR
*CONTACT PROPERTY ASSIGNMENT
 ,  , OTHER
PAD, DISC, RUBS
"""
OTHER = "*SURFACE INTERACTION, NAME=OTHER\n*FRICTION\n0.25\n"


@pytest.mark.parametrize("own", [True, False])
def test_general_contact(own, drafted):
    """A pair has its own property, all others that of the whole; excluded ones have no contact."""
    pair = GENERAL if own else GENERAL.replace("PAD, DISC, RUBS\n", "")
    scene, lost = drafted(interaction=INTERACTION + OTHER, pair=pair)
    (contact,) = scene.contact.values()
    assert contact.friction == (0.4 if own else 0.25) and not lost
    scene, lost = drafted(interaction=INTERACTION + OTHER, pair=GENERAL.replace("PAD, DISC, RUBS\n",
                          "*CONTACT EXCLUSIONS\nDISC, PAD\n"))  # fmt: skip
    assert not scene.contact and not lost


def test_motion_of_the_deck(drafted):
    """7 rad/s about the line from (1, 2, 0) to (1, 2, 5) mm; the part of the set moves.

    A velocity has its direction. Neither is proposed.
    """
    turns = "*MOTION, ROTATION\nTOP, 7., 1., 2., 0., 1., 2., 5.\n"
    scene, lost = drafted(after=STEP.format(turns))
    assert scene.motion.axis == "z" and scene.motion.rate == 7.0
    assert scene.motion.point == pytest.approx((1e-3, 2e-3, 0.0)) and not lost
    (contact,) = scene.contact.values()
    assert contact.faces == ("plate.disc", "block.pad")
    scene, lost = drafted(after=STEP.format("*MOTION, TRANSLATION\nBOTTOM, 250., 0., 1., 0.\n"))
    assert scene.motion.direction == (0.0, 1.0, 0.0) and not lost
    assert scene.motion.rate == pytest.approx(0.25)


def test_structural_damping_acts(drafted):
    """A loss factor alone would do nothing: the term is named with it."""
    scene, lost = drafted(materials=MATERIALS.replace("*MATERIAL, NAME=IRON",
                          "*DAMPING, STRUCTURAL=0.02, ALPHA=3.\n*MATERIAL, NAME=IRON"))  # fmt: skip
    assert scene.materials["LINING"].loss == 0.02 and scene.damping.loss
    assert scene.damping.reference == pytest.approx(2 * np.pi * 6e3)
    assert len(lost) == 1 and "ALPHA = 3.: write stability.damping.rayleigh" in lost[0]


def test_a_surface_without_faces_is_the_boundary(drafted):
    """Free faces of 6 hexahedra of the plate: 6 + 6 + 10 of 22 on the boundary."""
    drafted(mesh=MESH + "*SURFACE, NAME=ALL\nPLATE,\n")
    found = read_mesh_file(
        drafted(mesh=MESH + "*SURFACE, NAME=ALL\nPLATE,\n")[0].file.with_suffix(".inp")
    )
    assert len(found.facet_groups["ALL"]) == 22


def test_loads_by_numbers_in_steps(drafted):
    """Pressure on faces of elements, nodes held by their numbers: those of the last step."""
    scene, lost = drafted(
        held="*BOUNDARY\n" + "".join(f"{n}, 1, 3\n" for n in range(101, 113)) + "TOP, 1, 2\n",
        pressed=STEP.format("*DLOAD\nBLOCK, P2, 0.5\n"),
        after=STEP.format("*DLOAD, OP=NEW\nBLOCK, P2, 0.3\n"),
    )
    assert [load.pressure for load in scene.loads.values()] == [pytest.approx(0.3e6)]
    assert scene.supports["plate.boundary_xyz"] == ("x", "y", "z") and not lost
    _, lost = drafted(pressed=STEP.format("*DLOAD\nNOWHERE, P2, 0.5\n"))
    assert "set 'NOWHERE' is used before it is defined" in lost[0]


def test_an_element_written_twice(drafted):
    """Refused with both numbers, whatever the order of its nodes."""
    twice = "*ELEMENT, TYPE=C3D8, ELSET=BLOCK\n9001, 4, 1, 2, 5, 13, 10, 11, 14\n"
    with pytest.raises(SceneError, match=r"elements 1 and 9001 have the same corners \(1 such"):
        drafted(mesh=MESH + twice)


@pytest.mark.parametrize("keyword", ["*NODE, INPUT=a", "*ELEMENT, TYPE=C3D8, OFFSET=3",
                                     "*NSET, NSET=A, INPUT=a",
                                     "*SURFACE, NAME=A, TYPE=CUTTING SURFACE",
                                     "*SURFACE, NAME=A, CROP"])  # fmt: skip
def test_options_of_the_mesh_are_understood_or_refused(keyword, drafted):
    with pytest.raises(SceneError, match=r"not understood|are not read"):
        drafted(mesh=MESH + keyword + "\n1, 2\n")


REF = "*NODE, NSET=REF\n999, 30., 15., 20.\n"
COUPLED = REF + "*COUPLING, REF NODE=REF, SURFACE=BACK\n"
CHANGED = "*CHANGE FRICTION, INTERACTION=RUBS{}\n*FRICTION\n.1\n"
LUMP = COUPLED + "*ELEMENT, TYPE=MASS, ELSET=L\n9999, 999\n*MASS, ELSET=L{}\n1e-5\n"
SPRUNG = COUPLED + "*ELEMENT, TYPE=SPRING1, ELSET=S\n9999, 999\n*SPRING, ELSET=S{}\n3\n70.\n"
REMOVED = "*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE{}\nPAD, DISC\n"
# Where each taken keyword stands in the small deck, with data lines that are taken.
PLACES = {
    "STEP": ("after", "*STEP{}\n*STATIC\n*END STEP\n"),
    "STATIC": ("after", "*STEP\n*STATIC{}\n0.1, 1.\n*END STEP\n"),
    "FREQUENCY": ("modes", "*STEP\n*FREQUENCY{}\n10\n*END STEP\n"),
    "COMPLEX FREQUENCY": ("modes", "*STEP\n*COMPLEX FREQUENCY{}\n10\n*END STEP\n"),
    "AMPLITUDE": ("pressed", "*AMPLITUDE, NAME=A{}\n0., 0., 1., 1.\n"
                  + STEP.format("*DSLOAD, AMPLITUDE=A\nBACK, P, 0.5\n")),
    "MODEL CHANGE": ("after", STEP.format(REMOVED)),
    "BOUNDARY": ("held", HELD + "*BOUNDARY{}\nSIDE, 3\n"),
    "CLOAD": ("after", STEP.format("*CLOAD{}\nSIDE, 1, 3.\n")),
    "DLOAD": ("pressed", STEP.format("*DLOAD{}\nBLOCK, P2, 1.\n")),
    "DSLOAD": ("pressed", STEP.format("*DSLOAD{}\nBACK, P, 1.\n")),
    "TRANSFORM": ("before", "*TRANSFORM, NSET=TOP{}\n0, 1, 0, 1, 0, 0\n"),
    "MOTION": ("after", STEP.format("*MOTION, ROTATION{}\nTOP, 7., 0., 0., 0., 0., 0., 1.\n")),
    "SURFACE INTERACTION": ("before", "*SURFACE INTERACTION, NAME=OTHER{}\n1.,\n"),
    "CHANGE FRICTION": ("after", STEP.format(CHANGED)),
    "FRICTION": ("interaction", INTERACTION.replace("*FRICTION", "*FRICTION{}")),
    "SURFACE BEHAVIOR": ("interaction", "*SURFACE INTERACTION, NAME=RUBS\n*SURFACE BEHAVIOR{}\n"
                         "*FRICTION\n0.4\n"),
    "CONTACT PAIR": ("pair", "*CONTACT PAIR, INTERACTION=RUBS{}\nPAD, DISC\n"),
    "TIE": ("pair", "*TIE, NAME=GLUE{}\nPAD, DISC\n"),
    "CONTACT": ("pair", "*CONTACT{}\n*CONTACT INCLUSIONS, ALL EXTERIOR\n"
                "*CONTACT PROPERTY ASSIGNMENT\n ,  , RUBS\n"),
    "CONTACT INCLUSIONS": ("pair", "*CONTACT\n*CONTACT INCLUSIONS{}\nPAD, DISC\n"),
    "CONTACT EXCLUSIONS": ("before", "*CONTACT EXCLUSIONS{}\nPAD, BACK\n"),
    "CONTACT PROPERTY ASSIGNMENT": ("pair", "*CONTACT PROPERTY ASSIGNMENT{}\nPAD, DISC, RUBS\n"),
    "COUPLING": ("before", REF + "*COUPLING, REF NODE=REF, SURFACE=PAD{}\n*DISTRIBUTING\n"),
    "KINEMATIC": ("before", COUPLED.replace("BACK", "BOTTOM") + "*KINEMATIC{}\n1, 6\n"),
    "DISTRIBUTING": ("before", COUPLED + "*DISTRIBUTING{}\n"),
    "RIGID BODY": ("before", REF + "*RIGID BODY, REF NODE=REF, NSET=BOTTOM{}\n"),
    "MATERIAL": ("before", "*MATERIAL, NAME=OTHER{}\n"),
    "ELASTIC": ("before", "*MATERIAL, NAME=OTHER\n*ELASTIC{}\n100., 0.3\n"),
    "DENSITY": ("before", "*MATERIAL, NAME=OTHER\n*DENSITY{}\n3e-9\n"),
    "DAMPING": ("before", "*MATERIAL, NAME=OTHER\n*DAMPING{}\n"),
    "SOLID SECTION": ("before", "*SOLID SECTION, ELSET=BLOCK, MATERIAL=LINING{}\n"),
    "ELEMENT": ("before", LUMP), "MASS": ("before", LUMP), "SPRING": ("before", SPRUNG),
}  # fmt: skip
# Values of options that no scene can follow, and options without which the rest holds.
STRANGE = {
    "STEP": ["NLGEOM", "NLGEOM=YES"], "AMPLITUDE": ["VALUE=ABSOLUTE"],
    "BOUNDARY": ["TYPE=VELOCITY", "OP=NO"], "CONTACT PAIR": ["ADJUST=0.1", "TYPE=OTHER"],
    "SURFACE BEHAVIOR": ["PRESSURE-OVERCLOSURE=TABULAR", "PRESSURE-OVERCLOSURE=EXPONENTIAL",
                         "PRESSURE-OVERCLOSURE=SCALE FACTOR"],
    "MOTION": ["TYPE=DISPLACEMENT"], "CHANGE FRICTION": ["RESET", "AMPLITUDE=A"],
    "ELASTIC": ["TYPE=LAMINA"], "DAMPING": ["ALPHA=1.", "BETA=1."], "TRANSFORM": ["TYPE=S"],
    "SOLID SECTION": ["ORIENTATION=O"], "MODEL CHANGE": ["TYPE=ELEMENT"],
    "COMPLEX FREQUENCY": ["FRICTION DAMPING=YES"],
}  # fmt: skip


def test_every_keyword_that_is_read_has_its_options():
    """The table and the readers name the same keywords, but for those that the steps use up."""
    used_up = {"STEP", "STATIC", "FREQUENCY", "COMPLEX FREQUENCY", "AMPLITUDE", "MODEL CHANGE",
               "TRANSFORM"}  # fmt: skip
    assert (
        KNOWN.keys() == _READERS[".inp"].keys() | used_up and not KNOWN.keys() & HARMLESS["abaqus"]
    )
    shells = {"SHELL SECTION", "SHELL GENERAL SECTION"}  # tests/extras/decks/test_shells.py
    assert PLACES.keys() == KNOWN.keys() - shells


@pytest.mark.parametrize("keyword", PLACES)
def test_each_option_is_taken_or_has_its_line(keyword, drafted):
    """Never neither: without options no remark, and a line for one that nobody knows."""
    place, text = PLACES[keyword]
    _, lost = drafted(**{place: text.format("")})
    assert not lost, lost
    for option in ["NO SUCH OPTION", "NO SUCH=1", *STRANGE.get(keyword, [])]:
        if keyword == "ELEMENT":  # its options are those of the mesh
            continue
        _, lost = drafted(**{place: text.format(f", {option}")})
        said = [
            line for line in lost if f"*{keyword}" in line or keyword in ("AMPLITUDE", "TRANSFORM")
        ]
        assert said, (option, lost)
        assert all(re.search(r"\(brake.inp:\d+", line) for line in said)


def test_an_unknown_option_of_a_set_has_its_line(drafted):
    _, lost = drafted(mesh=MESH + "*NSET, NSET=A, FREQUENCY=100\n1, 2\n")
    assert len(lost) == 1 and "FREQUENCY=100 (brake.inp:" in lost[0]


def test_unknown_keywords_have_their_lines(drafted):
    """Whatever it is: only output and what others name is silent."""
    words = ["EXPANSION", "EQUATION", "INITIAL CONDITIONS", "CLEARANCE", "CONNECTOR SECTION",
             "NO SUCH KEYWORD", "TEMPERATURE", "PRE-TENSION SECTION"]  # fmt: skip
    _, lost = drafted(before="".join(f"*{word}\n1, 2\n" for word in words))
    assert [any(line.startswith(f"*{word} (brake") for line in lost) for word in words] == [
        True
    ] * len(words)
    _, lost = drafted(
        after=STEP.format("".join(f"*{word}\nU,\n" for word in sorted(HARMLESS["abaqus"])))
    )
    assert not lost
