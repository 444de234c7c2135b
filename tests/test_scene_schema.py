"""The JSON Schema of a scene says what the reader says."""

import json
import re
import tomllib

import jsonschema
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from places import BLOCK, ROOT

SCENES = {path.name: path.read_text() for path in (ROOT / "scripts" / "scenes").glob("*.toml")}
SCENES |= {
    f"{page.name} {i}": text
    for page in (ROOT / "docs").glob("*.md")
    for i, text in enumerate(re.findall(r"```toml\n(?!\[project)(.*?)```", page.read_text(), re.S))
}


@pytest.fixture(scope="module")
def validator():
    from brake_fenicsx.scene import scene_type
    from brake_fenicsx.scene.keys import json_schema

    schema = json_schema(scene_type())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_of_scripts_and_pages_are_valid(name, validator):
    assert [e.message for e in validator.iter_errors(tomllib.loads(SCENES[name]))] == []


def test_there_are_scenes_in_both_places():
    assert len([n for n in SCENES if ".md" in n]) >= 5 and len(SCENES) >= 9


@pytest.mark.parametrize(
    "change",
    [
        "contact.block_plate.frcition=0.3", "micros={}", "parts.block.lenght='3 mm'",
        "parts.block.radius='3 mm'", "stability.damping.raleigh=[0, 0]", "parts=[]",
        "parts.block=[]", "loads='x'", "contact=nan", "materials.iron=-1", "loads=1",
        "samples.n=2.5", "samples.n=0", "stability.tolerance='1'", "parts.block.builder='cube'",
        "contact.block_plate.friction=-0.1", "stages=['statbility']", "materials.iron.E='1,5 GPa'",
        "stability.damping.loss=1", "parts.block.material=3", "supports.'block.top'='held'",
        "micro={ laws='many' }", "surface={ level='flat' }", "mesh.order=3",
        "materials.iron.rho=7200", "countermeasures=[{ key = 'motion.speed' }]",
        "countermeasures=[{ key = 'motion.speed', to = ['2 m/s'] }]",
        "surface={ scan = 1 }", "surface={ scan = ['a.npz', 1] }",
        "surface={ window = '1 mm' }", "surface={ spectrum = 'raw' }",
        "equilibrium.tolerance='tight'",
    ],
)  # fmt: skip
def test_what_the_schema_refuses_the_reader_refuses(change, validator):
    """An unknown key, or a value of a wrong type."""
    from brake_fenicsx.scene.read import _override

    table = tomllib.loads(BLOCK.read_text())
    _override(table, change)
    assert list(validator.iter_errors(table))
    with pytest.raises(SceneError):
        read_scene(BLOCK, [change])


def test_command_prints_it_with_meanings_and_defaults(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert set(schema["properties"]) == {
        "stages", "surface", "micro", "mesh", "parts", "materials", "contact", "ties",
        "supports", "springs", "masses", "loads", "motion", "equilibrium", "stability", "samples",
        "limit_cycle", "sweep", "countermeasures", "extensions", "states",
    }  # fmt: skip
    block = schema["$defs"]["Block"]["properties"]
    assert block["length"]["default"] == "40 mm"
    assert block["length"]["description"] == "extent along x"
