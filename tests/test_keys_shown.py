"""Every key of a scene stands in a scene, script or page that we ship."""

import re

from places import ROOT

SHOWN = ("scripts", "docs", "README.md")


def shown():
    """Text of all scenes, scripts and pages but for the reference of the keys itself."""
    files = [f for name in SHOWN for f in [ROOT / name, *(ROOT / name).rglob("*")]]
    kinds = {".toml", ".py", ".md", ""}
    texts = (f.read_text() for f in files if f.suffix in kinds and f.is_file())
    return "\n".join(text for text in texts if not text.startswith("# Reference of a scene"))


def keys():
    """Sections and keys of the reference."""
    section = ""
    for line in (ROOT / "docs" / "scene.md").read_text().splitlines():
        if found := re.match(r"#+ `?\[+([^\]]+)\]", line):
            section = found[1]
        elif found := re.match(r"\| `(\w+)` \|", line):
            yield section, found[1]


def test_every_key_is_shown():
    text, found = shown(), list(keys())
    assert len(found) > 200
    assert not [k for k in found if not re.search(rf"\b{k[1]}\"?\s*=|\.{k[1]}\b", text)]
