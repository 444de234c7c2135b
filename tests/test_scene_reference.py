"""docs/scene.md says what the dataclasses say."""

import re
from dataclasses import MISSING, fields, make_dataclass
from math import inf

import pytest

from brake_fenicsx.scene.keys import key
from brake_fenicsx.scene.units import to_si
from places import ROOT
from processes import script

reference = script("scene_reference.py")


def test_page_is_what_the_script_writes():
    """A key added, renamed or given another default without the page being written again."""
    page = (ROOT / "docs" / "scene.md").read_text()
    assert page == reference.reference(), "run scripts/scene_reference.py"


def test_every_section_a_scene_may_have_is_there():
    from brake_fenicsx.scene import scene_type

    page = reference.reference()
    headings = set(re.findall(r"^## \[*(\w+)", page, re.M))
    assert headings == {f.name for f in fields(scene_type()) if not f.metadata.get("internal")}


def test_printed_defaults_are_read_back_to_the_same_number():
    """A default shown in mm that is not the default in m would send a user astray."""
    from brake_fenicsx.geometry.pad import Pad
    from brake_fenicsx.scene import Micro, Statistics
    from brake_fenicsx.scene.samples_section import Classical

    seen = 0
    for cls in (Pad, Micro, Statistics, Classical):
        for f in fields(cls):
            unit = f.metadata.get("unit")
            if unit and isinstance(f.default, float):
                text = reference.default_text(f).strip('`"')
                assert to_si(text, unit) == pytest.approx(f.default, rel=1e-9), f.name
                seen += 1
    assert seen > 15


def test_a_key_without_meaning_is_refused():
    odd = make_dataclass("Odd", [("length", float, key("m", default=1.0))])
    with pytest.raises(ValueError, match="length"):
        reference.table(odd)


@pytest.mark.parametrize(
    ("default", "unit", "shown"),
    [
        (2.825e-3, "m", '`"2.825 mm"`'), (None, "m", "-"), (inf, "", "-"), (True, "", "`true`"),
        (MISSING, "m", "**required**"), ((5e-3, 3.0), "m", '`["5 mm", "3000 mm"]`'),
    ],
)  # fmt: skip
def test_defaults_are_shown_as_one_writes_them(default, unit, shown):
    cls = make_dataclass("One", [("x", object, key(unit, default=default))])
    assert reference.default_text(fields(cls)[0]) == shown
