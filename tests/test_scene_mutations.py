"""Damaged scenes: each is accepted or refused in a line, none ends in a traceback."""

import datetime
import json
import math
import random
import tomllib

import jsonschema
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene, scene_type
from brake_fenicsx.scene.digest import in_effect
from brake_fenicsx.scene.keys import json_schema
from brake_fenicsx.scene.warnings import unusual
from coarse_block import SCENES

# Every section and kind of value, on a few cells.
RICH = tomllib.loads((SCENES / "block_on_plate.toml").read_text())
LINING = RICH["materials"]["lining"]
RICH |= tomllib.loads("""
stages = ["surface", "micro", "equilibrium", "stability", "uncertainty", "report"]
[surface]
statistics = { S_q = "30 um", c2 = -4.0 }
low = "flat"
[micro]
patch = "mesh"
pixels = 16
laws = 2
[contact.block_plate]
faces = ["block.bottom", "plate.top"]
friction = { static = 0.6, kinetic = 0.5, decay = "1 m/s" }
gap = "hdf"
[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"
loss = 0.01
[stability]
band = ["0 Hz", "40 kHz"]
threshold = 0.01
damping = { rayleigh = ["20 1/s", "1e-8 s"], loss = true, omega_ref = "2 kHz", slope = true }
[samples]
n = 3
approaches = ["multi-scale", "joint", "classical"]
classical = { penalty = "2e13 Pa/m" }
joint = { n = 4, design = "sobol" }
[samples.random]
"materials.lining.C44" = { law = "uniform", spread = 0.1 }
"loads.\\"block.top\\".pressure" = { law = "normal", mean = "5 bar", sd = "1 bar", min = "1 bar" }
"materials.iron.E" = { law = "measured", values = ["120 GPa", "130 GPa"] }
[[countermeasures]]
key = "parts.block.height"
to = "22 mm"
[[countermeasures]]
key = "materials.iron.rho"
to = "7 g/cm^3"
""")
RICH["materials"]["lining"] = LINING
VALUES = (
    [], {}, "", "x", True, False, 0, -1, 1.5, math.nan, math.inf, -math.inf, 10**30, 10**400,
    -1e-300, "nan m", "inf GPa", "1,5 mm", "1e400 bar", "5 parsec", "-3 mm", "\0",
    300 * "long", [[]], [1, "a"], {"a": {"b": 1}}, [{}], datetime.date(2026, 1, 1),
    datetime.time(12), "~/none", "mesh",
)  # fmt: skip


def toml(value):
    """A value as TOML, tables inline."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{json.dumps(k)} = {toml(v)}' for k, v in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value)
    return str(value).lower() if isinstance(value, bool | float) else str(value)


def dump(table, path):
    path.write_text("".join(f"{json.dumps(k)} = {toml(v)}\n" for k, v in table.items()))


def places(value, above=()):
    """Keys and positions in a nested table that lead to each value."""
    inner = value.items() if isinstance(value, dict) else ()
    inner = enumerate(value) if isinstance(value, list) else inner
    for name, below in inner:
        yield (*above, name)
        yield from places(below, (*above, name))


def damaged(table, rng):
    """A copy in which one to three values are missing, renamed, of another type, or extreme."""
    table = json.loads(json.dumps(table))
    for _ in range(rng.randint(1, 3)):
        *path, last = rng.choice(list(places(table)))
        holder = table
        for step in path:
            holder = holder[step]
        old, how = holder[last], rng.choice(("delete", "rename", "retype", "extreme", "wrap"))
        if how == "delete":
            del holder[last]
        elif how == "rename" and isinstance(holder, dict):
            holder[rng.choice((f"{last}s", last[1:], "no.such", "", "a\nb"))] = holder.pop(last)
        elif how == "extreme" and isinstance(old, str):
            number, _, unit = old.partition(" ")
            holder[last] = (
                f"{rng.choice(('1e30', '1e-30', '0', '-5', '1e9', '7'))} {unit or number}"
            )
        elif how == "wrap":
            holder[last] = rng.choice(([old], {"a": old}, str(old)))
        else:
            holder[last] = rng.choice(VALUES)
        if not table:
            break
    return table


def test_damaged_scenes_are_read_or_refused(tmp_path):
    dump(RICH, path := tmp_path / "scene.toml")
    assert read_scene(path).stages
    schema = jsonschema.Draft202012Validator(json_schema(scene_type()))
    refused = 0
    for seed in range(500):
        dump(damaged(RICH, random.Random(seed)), path)
        try:
            scene = read_scene(path)
        except SceneError as error:
            assert str(error).startswith(f"{path}: "), seed
            assert len(str(error)) < 1000, seed
            refused += 1
        else:
            assert all("\n" not in line for line in unusual(scene))
            json.dumps(in_effect(scene), allow_nan=False)
            assert list(schema.iter_errors(scene.table)) == [], seed
    assert 350 < refused < 495


def test_long_values_are_shown_short(tmp_path):
    """Every list a hundred times as long, and every text: a refusal stays a line of a screen."""
    refused = 0
    for *above, last in places(RICH):
        table = json.loads(json.dumps(RICH))
        holder = table
        for step in above:
            holder = holder[step]
        if not isinstance(holder[last], list | str):
            continue
        holder[last] = 100 * holder[last]
        dump(table, path := tmp_path / "scene.toml")
        try:
            read_scene(path)
        except SceneError as error:
            assert len(str(error)) < 600, (above, last, str(error))
            refused += 1
    assert refused > 60


COARSE = {"parts": {"block": {"size": "20 mm"}, "plate": {"size": "20 mm"}}}


def readable(table, path):
    """Whether a scene passes all that is known without a mesh."""
    dump(table, path)
    try:
        read_scene(path)
    except SceneError:
        return False
    return True


@pytest.mark.long
def test_check_of_damaged_scenes_is_0_or_2(tmp_path, capsys):
    """The whole command, mesh and matrices included, where reading alone refuses nothing."""
    whole = json.loads(json.dumps(RICH))
    for name, part in COARSE["parts"].items():
        whole["parts"][name] |= part
    path, states = tmp_path / "scene.toml", []
    for seed in range(10_000, 10_400):
        if not readable(damaged(whole, random.Random(seed)), path):
            continue
        states.append(main(["check", str(path)]))
        said = capsys.readouterr().err
        assert states[-1] in (0, 2), (seed, said)
        assert "Traceback" not in said and said.count("\n") <= 2, (seed, said)
        assert (states[-1] == 2) == ("brake-fenicsx:" in said), (seed, said)
    assert states.count(0) > 15 and states.count(2) > 2
