"""A scene: one TOML file to checked, frozen settings in SI units, and classes of a user's own.

Values are also replaced in the text of a scene, where all else stays as it is. Each is found by
trying: of the places where a key of this name is written, the right one is that which changes this
key of the scene, and no other, when the text is read again.
"""

import copy
import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from brake_fenicsx.arguments import of_kind
from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.extensions import MESH_FILES, Extensions, load, named, own_class
from brake_fenicsx.folder.files import whole_file

from . import contact_section, parts_section, rules, samples_section, scalars, stability_section
from .keys import contradictions, dotted, key_parts, read_table, shown, walk
from .scene import STAGES, ExtensionsTable, Scene, scene_type
from .units import in_unit_of

MAPPING = "scene (mapping)"  # in place of the path of a file
# What objects of each kind must do.
METHODS = {
    "contact": ("pressure", "stiffness", "vibration"),
    "friction": ("coefficient",),
    "damping": ("matrix",),
    "random": ("quantile",),
}

BOM, MARK = "\ufeff", "\ufffd"
# A text, a list of such or of numbers, a number or a word.
VALUE = r"""("[^"\n]*"|'[^'\n]*'|\[[^\[\]]*\]|[-+\w.]+)"""


def read_scene(
    file: str | Path | Mapping[str, Any], overrides: Sequence[str] = (), folder: str | Path = ""
) -> Scene:
    """Read and check a scene.

    Args:
        file: path of the TOML file, or its content as a mapping.
        overrides: "section.key=value" of the command line; the value is TOML, or a bare string.
        folder: from which the paths of a mapping start.

    Returns:
        The scene, in SI units.

    Raises:
        SceneError: one line naming file, key, value and remedy.
    """
    path = Path(file) if isinstance(file, str | Path) else Path(folder, MAPPING)
    try:
        table = _toml(path) if isinstance(file, str | Path) else from_text(toml_text(file))
        of_kind("scene", table, dict, "the path of a scene, or a mapping of its keys")
        if "allow" in (table.get("extensions") or ()):
            raise SceneError("extensions.allow: no scene allows its own code; leave it out")
        for text in overrides:
            _override(table, text)
        return _scene(path, table)
    except SceneError as error:
        # Names and texts of any length stand in messages; paths are shorter.
        long = r"'[^']{200,}'|\S{200,}"
        text = re.sub(long, lambda found: f"{found[0][:100]}...{found[0][-50:]}", str(error))
        raise SceneError(f"{path}: {text}") from None


def from_text(value: str) -> Any:
    """A value from its TOML."""
    return tomllib.loads(f"x = {value}")["x"]


def toml_text(value: Any, where: str = "scene") -> str:
    """The keys of a scene, or a value of one, as TOML; refused if TOML has no such value."""
    value = getattr(value, "tolist", lambda: value)()  # of NumPy
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(str(k))} = {toml_text(v, str(k))}" for k, v in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_text(v, where) for v in value)}]"
    of_kind(where, value, (str, int, float, Path), "a number, a text, a list or a mapping")
    return json.dumps(value, ensure_ascii=False, default=str)


def scene_text(scene: Scene) -> str:
    """Text of the file of a scene, or of its keys where there is none."""
    lines = (f"{json.dumps(k)} = {toml_text(v)}\n" for k, v in scene.table.items())
    return "".join(lines) if scene.file.name == MAPPING else scene.file.read_text("utf-8")


def _toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file; a byte order mark in front of it is left out."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError("a device or pipe, no file; give the path of a scene")
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError:
        raise SceneError("no such file; give the path of a scene") from None
    except OSError as error:
        raise SceneError(f"cannot be read ({error.strerror}); give the path of a scene") from None
    except (ValueError, RecursionError) as error:
        if path.suffix.lower() in MESH_FILES:
            raise SceneError(f"""a mesh file; brake-fenicsx init {path} writes a first scene of
                it""") from None
        if not isinstance(error, UnicodeDecodeError):
            remedy = "; write paths with / or in single quotes" if "\\" in str(error) else ""
            raise SceneError(f"not a TOML file: {error}{remedy}") from None
        line = error.object.count(b"\n", 0, error.start) + 1
        raise SceneError(f"line {line}: not UTF-8 text; save the scene as UTF-8") from None


def _override(table: dict[str, Any], text: str) -> None:
    """Replace one key of a scene: "section.key=value", the value TOML or a bare string."""
    name, sign, value = text.partition("=")
    if not sign:
        raise SceneError(f"--set {text}: write key=value")
    try:
        parsed = from_text(value)
    except (ValueError, RecursionError):
        parsed = value.strip()
    *path, last = key_parts(name.strip())
    for i, step in enumerate(path):
        table = table.setdefault(step, {})
        if not isinstance(table, dict):
            raise SceneError(f"--set {text}: {dotted(*path[: i + 1])} is {shown(table)}, no table")
    table[last] = parsed


def _scene(path: Path, table: dict[str, Any]) -> Scene:
    own, builders = own_objects(table, path.parent)
    scene: Scene = read_table(scene_type(tuple(builders.items())), table)
    for text in contradictions(scene):
        raise SceneError(text)
    if scene.surface and len(scene.surface.scans) == 1:  # a list of one is that one, in hashes too
        table = {**table, "surface": {**table["surface"], "scan": scene.surface.scans[0]}}
    roughness = any(c.law == "library" or c.gap != "none" for c in scene.contact.values())
    random = {
        n: samples_section.complete(d, n, path.parent) for n, d in scene.samples.random.items()
    }
    contact = {n: contact_section.with_table(c, n, path.parent) for n, c in scene.contact.items()}
    held = scene.supports.items()
    supports: dict[str, parts_section.Held] = {
        f: parts_section.DIRECTIONS if h == "clamped" else h for f, h in held
    }
    scene = replace(
        scene, contact=contact, supports=supports, file=path, table=table, own=own,
        stages=tuple(s for s in STAGES if s in scene.stages),
        samples=replace(scene.samples, random=random, roughness=roughness),
    )  # fmt: skip
    rules.check_consistent(scene)
    for extra in named(scene):
        if extra.check:
            scene = load(extra.check)(scene, partial(_changed, scene, extra.sections))
    return with_objects(scene, own)


def _changed(scene: Scene, sections: Iterable[str], text: str) -> Scene:
    """A scene without some sections after a replacement "key=value"."""
    table = {k: v for k, v in copy.deepcopy(scene.table).items() if k not in {*sections}}
    _override(table, text)
    return _scene(scene.file, table)


@dataclass(frozen=True, slots=True)
class _Alone:
    extensions: ExtensionsTable


def own_objects(table: Mapping[str, Any], folder: Path) -> tuple[Extensions, dict[str, Any]]:
    """Objects of the section [extensions] of a scene as it is written, and classes of builders.

    Raises:
        SceneError: the key, the name, and why it cannot be used.
    """
    if "extensions" not in table:
        return Extensions(), {}
    named = read_table(_Alone, {"extensions": table["extensions"]}).extensions
    made: dict[str, dict[str, Any]] = {}
    marks: dict[str, Any] = {}
    for kind in (*METHODS, "builders", "figures"):
        made[kind] = {}
        for name, written in getattr(named, kind).items():
            given = {"use": written} if isinstance(written, str) else written
            where = f"{dotted('extensions', kind, name)} = {shown(written)}"
            try:
                found, about = own_class(str(given.get("use", "")), folder, named.allow)
                if kind in METHODS:
                    found = found(**{k: v for k, v in given.items() if k != "use"})
                made[kind][name] = found
            except (ValueError, TypeError) as error:
                raise SceneError(f"{where}: {error}") from None
            if kind != "figures":
                marks[f"{kind}.{name}"] = [given, *about]
    builders = made.pop("builders")
    objects: dict[str, Any] = {**made, "damping": [*made["damping"].values()], "marks": marks}
    return Extensions(**objects), builders


def with_objects(scene: Scene, own: Extensions) -> Scene:
    """A scene with some objects.

    Args:
        scene: the scene.
        own: the objects.

    Raises:
        SceneError: there is no such interface or key, or no section for it.
    """
    at = f"{scene.file}: extensions"
    for kind, methods in METHODS.items():
        given = getattr(own, kind)
        for one in given.values() if isinstance(given, Mapping) else given:
            for method in methods:
                if not callable(getattr(one, method, None)):
                    raise SceneError(f"""{at}: an object of the type {type(one).__name__} has no
                        method {method!r}; see brake_fenicsx.extensions""")
    contact = dict(scene.contact)
    for key, laws in (("law", own.contact), ("friction", own.friction)):
        for name, law in laws.items():
            if name not in contact:
                raise SceneError(f"""{at}: there is no interface {name!r}; there are
                    {", ".join(contact)}""")
            table: Any = {key: law}
            contact[name] = replace(contact[name], **table)
    stability = scene.stability
    if own.damping:
        if stability is None:
            raise SceneError(f"{at}: damping needs the section [stability]")
        table = stability.damping or stability_section.Damping()
        terms = (*table.own, *own.damping)
        stability = replace(stability, damping=replace(table, own=terms))
    random: dict[str, Any] = {**scene.samples.random, **own.random}
    samples = replace(scene.samples, random=random)
    changed = replace(scene, contact=contact, stability=stability, samples=samples)
    for name in own.random:
        scalars.check_scalar(changed, f"{at}: {name}", name)
    return changed


def with_values(scene: Scene, values: Mapping[tuple[str, ...], Any]) -> str:
    """Text of a scene's file with other values of some keys.

    Args:
        scene: the scene.
        values: names of the tables and of the key -> value, SI.

    Raises:
        SceneError: the file does not write one of them.
    """
    file, units = scene.file, _units(scene)
    text = file.read_bytes().decode("utf-8")
    begin = BOM if text.startswith(BOM) else ""
    text = text.removeprefix(BOM)
    for path, value in values.items():
        text = _replaced(file, text, path, value, units.get(path, ""))
    return begin + text


def _units(scene: Scene) -> dict[tuple[str, ...], str | tuple[str, ...]]:
    """SI unit of each key, or of each number of its list."""
    units: dict[tuple[str, ...], str | tuple[str, ...]] = {}
    parts = [walk(part.parameters, ("parts", name)) for name, part in scene.parts.items()]
    for keys, about, _ in chain(walk(scene), *parts):
        unit = about.get("units") or about.get("unit", "")
        units[keys] = scalars.si_unit(scene, keys[-2]) if unit == "*" else unit
    return units | {tuple(scalars.SPEED.split(".")): scalars.si_unit(scene, scalars.SPEED)}


def write_text(file: Path, text: str) -> None:
    """Write it whole, or not at all, ends of lines as they are."""
    with whole_file(file) as part:
        part.write_bytes(text.encode("utf-8"))


def _replaced(
    file: Path, text: str, path: tuple[str, ...], value: Any, unit: str | tuple[str, ...]
) -> str:
    """The text with another value of one key, of an SI unit or one for each number of a list."""
    where, last = ".".join(path), re.escape(path[-1])
    wanted = tomllib.loads(text)
    table = wanted
    for name in path[:-1]:
        table = table.get(name, {})
    if not isinstance(table, dict) or path[-1] not in table:
        raise SceneError(f"{file}: {where}: the file does not write it; add it by hand")
    old, table[path[-1]] = table[path[-1]], MARK
    for match in re.finditer(rf"""(?<![\w-])["']?{last}["']?[ \t]*=[ \t]*{VALUE}""", text):
        head, tail = text[: match.start(1)], text[match.end(1) :]
        try:
            found = tomllib.loads(f'{head}"{MARK}"{tail}') == wanted
        except ValueError:
            continue
        if found:
            with located(f"{file}: {where}", ValueError):
                return f"{head}{toml_text(_written(old, value, unit))}{tail}"
    raise SceneError(f"{file}: {where}: cannot be replaced there; change it by hand")


def _written(old: Any, value: Any, unit: str | tuple[str, ...]) -> Any:
    """A value as the scene writes the old one: in its unit, and as a list if that is one."""
    if isinstance(value, str):
        return value
    many = value if isinstance(value, list | tuple) else [value]
    units = [unit] * len(many) if isinstance(unit, str) else unit
    like = old if isinstance(old, list) else [old]
    like = like if len(like) == len(many) else like[:1] * len(many)
    new = [in_unit_of(*one) for one in zip(many, like, units, strict=True)]
    return new if isinstance(old, list) or len(new) > 1 else new[0]
