"""A scene: one TOML file to checked, frozen settings in SI units.

Every key is a field of a dataclass here, or of a builder in ``geometry``; its metadata says the
unit ("unit"), the allowed sign ("sign": positive if absent, "zero", "any") and the choices
("choices"). What a scene does not name is None, and is neither built, assembled nor imported.
"""

from __future__ import annotations

import difflib
import hashlib
import importlib
import json
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.units import to_si

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")
BUILDERS = {"disc": "Disc", "pad": "Pad", "block": "Block"}
APPROACHES = ("multi-scale", "classical")


def key(unit: str = "", default: Any = MISSING, **metadata: Any) -> Any:
    """A field of a scene: unit, default, sign and choices."""
    metadata["unit"] = unit
    return (
        field(metadata=metadata)
        if default is MISSING
        else field(default=default, metadata=metadata)
    )


@dataclass(frozen=True, slots=True)
class Statistics:
    """[surface.statistics]: a surface known by its numbers alone."""

    S_q: float = key("m")
    S_sk: float = key(default=0.0, sign="any")
    S_ku: float = key(default=3.0)
    c1: float = key(default=-2.0, sign="any")
    c2: float = key(default=-4.5, sign="any")
    q_c: float = key("1/m", default=30e3)


@dataclass(frozen=True, slots=True)
class Surface:
    """[surface]: the scan, or statistics in its place."""

    scan: str | None = key(default=None)
    level: str = key(default="plane", choices=("none", "plane", "second-order"))
    size: tuple[float, ...] | None = key("m", default=None)
    height_unit: str | None = key(default=None)
    statistics: Statistics | None = None
    cutoff: float | None = key("m", default=None)
    low: str = key(default="extend", choices=("extend", "flat"))


@dataclass(frozen=True, slots=True)
class Micro:
    """[micro]: artificial patches and their contact."""

    patch: float = key("m", default=2.825e-3)
    pixels: int = key(default=128)
    boundary: str = key(default="free", choices=("free", "periodic"))
    laws: int = key(default=100)
    E: float = key("Pa", default=1983.3e6)
    nu: float = key(default=0.4054, sign="any")
    tolerance: float = key(default=1e-6)
    max_pressure: float = key(default=0.1)
    steps: int = key(default=20)
    bulk_compliance: str = key(default="remove", choices=("remove", "keep"))
    seed: int = key(default=1, sign="zero")


@dataclass(frozen=True, slots=True)
class Part:
    """[parts.NAME]: a builder with its parameters, and a material for each layer."""

    builder: str
    parameters: Any
    material: str | dict[str, str]


@dataclass(frozen=True, slots=True)
class MaterialTable:
    """[materials.NAME]: constants of the chosen model."""

    model: str = key(choices=("isotropic", "transversely-isotropic", "orthotropic"))
    rho: float = key("kg/m^3")
    E: float | tuple[float, ...] | None = key("Pa", default=None)
    nu: float | tuple[float, ...] | None = key(default=None, sign="any")
    G: tuple[float, ...] | None = key("Pa", default=None)
    C11: float | None = key("Pa", default=None)
    C12: float | None = key("Pa", default=None, sign="any")
    C13: float | None = key("Pa", default=None, sign="any")
    C33: float | None = key("Pa", default=None)
    C44: float | None = key("Pa", default=None)
    axis: float = key("rad", default=0.0, sign="any")


@dataclass(frozen=True, slots=True)
class Law:
    """[contact.NAME.law]: an analytic law in place of "library"."""

    linear: float | None = key("Pa/m", default=None)
    p0: float | None = key("Pa", default=None)
    u0: float | None = key("m", default=None)


@dataclass(frozen=True, slots=True)
class Contact:
    """[contact.NAME]: an interface between two faces, the pad's first."""

    faces: tuple[str, ...]
    law: str | Law = "library"
    discretisation: str = key(default="patch", choices=("patch",))
    gap: str = key(default="none", choices=("none", "hdf"))
    friction: float = key(default=0.0, sign="zero")
    friction_in_equilibrium: bool = True
    search: float | None = key("m", default=None)


@dataclass(frozen=True, slots=True)
class Load:
    """[loads]: a pressure on a face, applied in equal steps."""

    pressure: float = key("Pa")
    steps: int = key(default=1)


@dataclass(frozen=True, slots=True)
class Motion:
    """[motion]: rotation about z, or a direction."""

    axis: str | None = key(default=None, choices=("z",))
    direction: tuple[float, ...] | None = key(default=None, sign="any")
    speed: str = key(default="1 rad/s")

    @property
    def rotation(self) -> float:
        """Angular speed [rad/s] about the axis."""
        return to_si(self.speed, "rad/s")


@dataclass(frozen=True, slots=True)
class Stability:
    """[stability]: band and method of the eigenvalue analysis."""

    band: tuple[float, ...] = key("Hz", sign="zero")
    method: str = key(default="full", choices=("full", "reduced"))
    cutoff: float | None = key("Hz", default=None)
    zeta_max: float = key(default=0.1)
    verify: int = key(default=0, sign="zero")


@dataclass(frozen=True, slots=True)
class Classical:
    """[samples.classical]: perfect contact."""

    penalty: float = key("Pa/m", default=2e13)
    friction: float = key(default=0.5, sign="zero")


@dataclass(frozen=True, slots=True)
class Distribution:
    """[samples.random]: law of one random input."""

    law: str = key(choices=("normal", "uniform"))
    mean: float | None = key(default=None, sign="any")
    sd: float | None = key(default=None)
    min: float = key(default=-float("inf"), sign="any")
    max: float = key(default=float("inf"), sign="any")


@dataclass(frozen=True, slots=True)
class Samples:
    """[samples]: how many, of which approaches."""

    n: int = key(default=1)
    seed: int = key(default=1, sign="zero")
    design: str = key(default="random", choices=("random",))
    approaches: tuple[str, ...] = key(default=("multi-scale",))
    classical: Classical = field(default_factory=Classical)
    random: dict[str, Distribution] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene.

    Attributes:
        file: the TOML file.
        table: its content with the overrides of the command line.
        stages: stages to run, in order.
    """

    file: Path
    table: dict[str, Any]
    stages: tuple[str, ...]
    surface: Surface | None
    micro: Micro | None
    parts: dict[str, Part]
    materials: dict[str, MaterialTable]
    contact: dict[str, Contact]
    supports: dict[str, tuple[str, ...]]
    loads: dict[str, Load]
    motion: Motion | None
    stability: Stability | None
    samples: Samples

    def path(self, name: str) -> Path:
        """A file named in the scene, relative to the scene's folder."""
        return self.file.parent / name

    @staticmethod
    def hash(content: Any) -> str:
        """Hash of some content of a scene."""
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def read_scene(file: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Args:
        file: path of the TOML file.
        overrides: "section.key=value" of the command line; the value is TOML, or a bare string.

    Returns:
        The scene, in SI units.

    Raises:
        SceneError: one line naming file, key, value and remedy.
    """
    path = Path(file)
    try:
        table = tomllib.loads(path.read_text())
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file; give the path of a scene") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: not a TOML file: {error}") from None
    for text in overrides:
        _override(table, text)
    try:
        return _scene(path, table)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _override(table: dict[str, Any], text: str) -> None:
    name, sign, value = text.partition("=")
    if not sign:
        raise SceneError(f"--set {text}: write key=value")
    try:
        parsed = tomllib.loads(f"x = {value}")["x"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()
    *path, last = tomllib_key(name.strip())
    for step in path:
        table = table.setdefault(step, {})
    table[last] = parsed


def tomllib_key(name: str) -> list[str]:
    """The parts of a dotted key, quoted parts kept whole."""
    try:
        nested = tomllib.loads(f"{name} = 0")
    except tomllib.TOMLDecodeError:
        raise SceneError(f"--set {name}: not a dotted key") from None
    parts = []
    while isinstance(nested, dict):
        ((part, nested),) = nested.items()
        parts.append(part)
    return parts


def _scene(path: Path, table: dict[str, Any]) -> Scene:
    known = {f.name for f in fields(Scene)} - {"file", "table"}
    _check_keys(table, known, "")
    stages = tuple(table.get("stages", ()))
    for stage in stages:
        if stage not in STAGES:
            raise SceneError(f"stages: unknown stage {stage!r}; use {', '.join(STAGES)}")
    stages = tuple(s for s in STAGES if s in stages)
    if not stages:
        raise SceneError(f"stages = []: nothing to do; name some of {', '.join(STAGES)}")
    one = {
        name: _read(cls, table[name], name) if name in table else None
        for name, cls in (
            ("surface", Surface), ("micro", Micro), ("motion", Motion), ("stability", Stability)
        )
    }  # fmt: skip
    samples = _samples(table.get("samples", {}))
    return _consistent(Scene(
        path, table, stages, one["surface"], one["micro"],
        {n: _part(t, f"parts.{n}") for n, t in table.get("parts", {}).items()},
        {n: _read(MaterialTable, t, f"materials.{n}") for n, t in table.get("materials", {}).items()},
        {n: _read(Contact, t, f"contact.{n}") for n, t in table.get("contact", {}).items()},
        {n: _support(t, f"supports.{n}") for n, t in table.get("supports", {}).items()},
        {n: _read(Load, t, f"loads.{n}") for n, t in table.get("loads", {}).items()},
        one["motion"], one["stability"], samples,
    ))  # fmt: skip


def _samples(table: dict[str, Any]) -> Samples:
    random = table.get("random", {})
    rest = {k: v for k, v in table.items() if k != "random"}
    samples = _read(Samples, rest, "samples")
    drawn = {n: _read(Distribution, t, f'samples.random."{n}"') for n, t in random.items()}
    for name in samples.approaches:
        if name not in APPROACHES:
            raise SceneError(f"samples.approaches: {name!r}; use {', '.join(APPROACHES)}")
    return Samples(
        samples.n, samples.seed, samples.design, samples.approaches, samples.classical, drawn
    )


def _part(table: dict[str, Any], where: str) -> Part:
    builder = table.get("builder")
    if builder not in BUILDERS:
        raise SceneError(f"{where}.builder = {builder!r}: use one of {', '.join(BUILDERS)}")
    if "material" not in table:
        raise SceneError(f"{where}: no material; write material = NAME, or one NAME for each layer")
    module = importlib.import_module(f"brake_fenicsx.geometry.{builder}")
    rest = {k: v for k, v in table.items() if k not in ("builder", "material")}
    if rest.get("shim") is False:
        rest["shim"] = 0
    return Part(builder, _read(getattr(module, BUILDERS[builder]), rest, where), table["material"])


def _support(value: Any, where: str) -> tuple[str, ...]:
    if value == "clamped":
        return ("x", "y", "z")
    if isinstance(value, list) and value and set(value) <= {"x", "y", "z"}:
        return tuple(value)
    raise SceneError(f'{where} = {value!r}: write "clamped" or a list of "x", "y", "z"')


def _check_keys(table: Mapping[str, Any], known: set[str], where: str) -> None:
    for name in table:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(sorted(known))}"
            raise SceneError(
                f"{where + '.' if where else ''}{name} = {table[name]!r}: unknown key; {hint}"
            )


def _read(cls: Any, table: Any, where: str) -> Any:
    """Fill a dataclass from a table: known keys, units, signs, choices, nothing missing."""
    if not isinstance(table, dict):
        raise SceneError(f"{where} = {table!r}: write a table")
    _check_keys(table, {f.name for f in fields(cls)}, where)
    hints = typing.get_type_hints(cls)
    values = {}
    for f in fields(cls):
        if f.name in table:
            values[f.name] = _value(f, hints[f.name], table[f.name], f"{where}.{f.name}")
        elif f.default is MISSING and f.default_factory is MISSING:
            raise SceneError(f"{where}.{f.name}: missing; it has no default")
    return cls(**values)


def _value(f: Any, hint: Any, value: Any, where: str) -> Any:
    kinds = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    said = f"{where} = {value!r}"
    for kind in kinds:
        if hasattr(kind, "__dataclass_fields__") and isinstance(value, dict):
            return _read(kind, value, where)
    choices = f.metadata.get("choices")
    if choices and value not in choices:
        raise SceneError(f"{said}: use one of {', '.join(choices)}")
    sequence = next((k for k in kinds if typing.get_origin(k) is tuple), None)
    if sequence is not None and isinstance(value, list):
        inner = typing.get_args(sequence)[0]
        return tuple(_scalar(f, (inner,), v, said) for v in value)
    return _scalar(f, kinds, value, said)


def _scalar(f: Any, kinds: tuple[Any, ...], value: Any, said: str) -> Any:
    if bool in kinds:
        if not isinstance(value, bool):
            raise SceneError(f"{said}: write true or false")
        return value
    if str in kinds and isinstance(value, str):
        return value
    if int in kinds and float not in kinds:
        if not isinstance(value, int) or isinstance(value, bool):
            raise SceneError(f"{said}: write a whole number")
        number: float = value
    elif float in kinds:
        try:
            number = to_si(value, f.metadata.get("unit", ""))
        except ValueError as error:
            raise SceneError(f"{said}: {error}") from None
    else:
        raise SceneError(f"{said}: not of the right kind")
    sign = f.metadata.get("sign", "positive")
    if (sign == "positive" and not number > 0) or (sign == "zero" and not number >= 0):
        raise SceneError(f"{said}: must be {'positive' if sign == 'positive' else 'zero or more'}")
    return number


def _consistent(scene: Scene) -> Scene:
    """Refuse scenes whose sections contradict each other."""
    s = scene
    needs = {
        "surface": s.surface,
        "micro": s.micro,
        "equilibrium": s.contact,
        "stability": s.stability,
    }
    for stage, section in needs.items():
        if stage in s.stages and not section:
            raise SceneError(
                f"stages: {stage!r} needs a section [{'contact' if stage == 'equilibrium' else stage}]"
            )
    if s.surface and not (s.surface.scan or s.surface.statistics):
        raise SceneError("surface: name a scan or statistics")
    if s.surface and s.surface.scan and not s.path(s.surface.scan).exists():
        raise SceneError(
            f"surface.scan = {s.surface.scan!r}: no such file; paths start at the scene's folder"
        )
    for name, part in s.parts.items():
        used = [part.material] if isinstance(part.material, str) else part.material.values()
        for material in used:
            if material not in s.materials:
                raise SceneError(
                    f"parts.{name}.material = {material!r}: there is no [materials.{material}]"
                )
    for name, contact in s.contact.items():
        if len(contact.faces) != 2:
            raise SceneError(
                f"contact.{name}.faces = {list(contact.faces)!r}: write two faces, the pad's first"
            )
        if (
            contact.law == "library"
            and "micro" not in s.stages
            and "multi-scale" in s.samples.approaches
        ):
            raise SceneError(f'contact.{name}.law = "library": needs the stages surface and micro')
        if isinstance(contact.law, str) and contact.law != "library":
            raise SceneError(
                f'contact.{name}.law = {contact.law!r}: write "library", {{ linear = "2e13 Pa/m" }} or {{ p0 = .., u0 = .. }}'
            )
        if contact.gap == "hdf" and "surface" not in s.stages:
            raise SceneError(f'contact.{name}.gap = "hdf": needs the stage surface')
    if "micro" in s.stages and "surface" not in s.stages:
        raise SceneError("stages: 'micro' needs 'surface'")
    if "stability" in s.stages and "equilibrium" not in s.stages:
        raise SceneError("stages: 'stability' needs 'equilibrium'")
    if s.stability and (len(s.stability.band) != 2 or s.stability.band[0] >= s.stability.band[1]):
        raise SceneError(f"stability.band = {list(s.stability.band)!r} Hz: write [lowest, highest]")
    sliding = any(c.friction for c in s.contact.values()) or "classical" in s.samples.approaches
    if "equilibrium" in s.stages and sliding and s.motion is None:
        raise SceneError("motion: friction needs a section [motion]")
    if s.motion:
        unit = "m/s" if s.motion.direction else "rad/s"
        try:
            to_si(s.motion.speed, unit)
        except ValueError as error:
            raise SceneError(f"motion.speed = {s.motion.speed!r}: {error}") from None
    for name in s.samples.random:
        if not (
            name.startswith("contact.") and name.endswith(".friction") and name[8:-9] in s.contact
        ):
            raise SceneError(
                f'samples.random."{name}": only contact.NAME.friction may be random so far'
            )
    return scene
