"""[samples]: how many, of which approaches, what is random in them; [sweep]: what is followed.

A random input, or a parameter of a sweep, is named by the dotted key of the scalar it replaces
(``SCALARS``); its numbers carry that scalar's unit. Of a material written by stiffnesses, these may
vary; of an isotropic one E and nu; of any other one the constants for each axis, however its table
is written: the named ones change, the others stay.
"""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import npz_names, read_npz, reading

from .keys import KeyMistake, below, key, value_type
from .units import factor_to_si, to_si

APPROACHES = ("multi-scale", "classical", "parametric", "joint")
ROUGH = ("multi-scale", "joint")  # of rough contact
NO_ROUGH_SAMPLES = "there are no rough samples; name multi-scale or joint in samples.approaches"
DESIGNS = ("random", "latin-hypercube", "sobol", "fast", "rbd-fast", "saltelli")
DISTRIBUTIONS = ("normal", "lognormal", "uniform", "measured")
# Keys of the scalars that may take other values than the scene's: table, keys, SI unit.
SCALARS = (
    ("contact.NAME", "friction", ""),
    ("loads.FACE", "pressure", "Pa"),
    ("materials.NAME", "loss nu nu_12 nu_31 nu_32", ""),
    ("materials.NAME", "E E_1 E_2 E_3 G_12 G_13 G_23", "Pa"),
    ("materials.NAME", "C11 C22 C33 C12 C13 C23 C44 C55 C66", "Pa"),
    ("materials.NAME", "rho", "kg/m^3"),
    ("masses.FACE", "mass", "kg"),
    ("motion", "speed", "rad/s or m/s"),
    ("parts.PAD", "lining plate shim slot slot_depth chamfer chamfer_depth", "m"),
    ("parts.DISC", "thickness cheek hat flange radius bore", "m"),
    ("parts.BLOCK", "length width height", "m"),
    ("parts.NAME", "layers.LAYER morph.LENGTH.value", "m"),
    ("samples.classical", "penalty", "Pa/m"),
    ("stability.damping.rayleigh", "alpha", "1/s"),
    ("stability.damping.rayleigh", "beta", "s"),
)
ENGINEERING = ("E_1", "E_2", "E_3", "nu_12", "nu_31", "nu_32", "G_12", "G_13", "G_23")
INFINITY = float("inf")
MAX_STEPS = 100_000  # of a sweep


@dataclass(frozen=True, slots=True)
class Classical:
    """[samples.classical]: perfect contact.

    Attributes:
        penalty: contact stiffness.
        friction: friction coefficient; the coefficient of each interface if not given.
    """

    penalty: float = key("Pa/m", default=2e13, band=(1e9, 1e17))
    friction: float | None = key(default=None, sign="zero", band=(0.0, 1.5))


@dataclass(frozen=True, slots=True)
class Design:
    """[samples.parametric], [samples.joint]: number and design of one approach's samples.

    Attributes:
        n: samples; the number in [samples] if not given. FAST and Saltelli's design use the largest
            possible number not above ``n``.
        design: see [studies.md](studies.md); the design of [samples] if not given (default of
            "parametric": RBD-FAST, which needs fewer samples than FAST).
        curves: independent search curves of FAST for each input: intervals come from their spread.
    """

    n: int | None = key(default=None)
    design: str | None = key(default=None, choices=DESIGNS)
    curves: int | None = key(default=None, most=1000)


@dataclass(frozen=True, slots=True)
class Distribution:
    """[samples.random]: distribution of the input with that dotted key; min = "2 bar" has its unit.

    Attributes:
        law: "normal", "lognormal", "uniform", or "measured" values.
        mean: mean of the value, also for the lognormal law (not of the logarithm).
        sd: standard deviation of the value, also for the lognormal law.
        min: lower bound; truncates any distribution.
        max: upper bound; truncates any distribution.
        spread: uniform between (1 - spread) and (1 + spread) times the value in the scene.
        values: measured values, at least two; each value is drawn unchanged, with equal
            probability.
        file: text file of numbers, or npz, in place of ``values``.
        array: name of the array in an npz file that holds several.
        unit: unit of the numbers in the file.
        correlation: with other random inputs, by their keys, each pair once: of the logarithms of
            two lognormal inputs, of the values of two normal ones, else of normal scores.
        digest: hash of the values read from the file.
    """

    law: str = key(choices=DISTRIBUTIONS)
    mean: float | None = key("*", default=None, sign="any")
    sd: float | None = key("*", default=None)
    min: float = key("*", default=-INFINITY, sign="any")
    max: float = key("*", default=INFINITY, sign="any")
    spread: float | None = key(default=None, rule=below(1, "must be below 1"))
    values: tuple[float, ...] = key("*", default=(), sign="any")
    file: str | None = key(default=None)
    array: str | None = key(default=None)
    unit: str | None = key(default=None)
    correlation: dict[str, float] = key(default=dict, sign="any")
    digest: str = key(default="", internal=True)

    def contradictions(self) -> Iterator[str]:
        """What each law needs."""
        bounds = np.isfinite([self.min, self.max])
        if not self.min < self.max:
            yield f": min = {self.min:g} must lie below max = {self.max:g}"
        if self.law in ("normal", "lognormal") and None in (self.mean, self.sd):
            yield f": a {self.law} law needs mean and sd"
        if self.law == "lognormal" and self.mean is not None and self.mean <= 0:
            yield f".mean = {self.mean:g}: a lognormal law needs a positive mean"
        if self.law == "uniform" and self.spread is None and not bounds.all():
            yield ": a uniform law needs min and max, or spread"
        if self.spread is not None and (self.law != "uniform" or bounds.any()):
            yield ".spread: only for a uniform law, in place of min and max"
        if self.law != "measured" and (self.values or self.file):
            yield ': values and file belong to law = "measured"'


@dataclass(frozen=True, slots=True)
class Samples:
    """[samples]: how many, of which approaches.

    Attributes:
        n: number of samples of each random approach.
        seed: seed of all samples.
        design: points of the random inputs ([studies.md](studies.md)).
        curves: independent search curves of FAST for each input.
        approaches: list of approaches, from "multi-scale", "classical", "parametric", "joint".
        classical: perfect contact.
        parametric: number and design of its samples.
        joint: number and design of its samples.
        limit: share of samples beyond which a family is called likely to squeal.
        random: law of each random input.
        roughness: whether samples of rough contact draw laws or critical gaps.
    """

    n: int = key(default=1)
    seed: int = key(default=1, sign="zero", most=2**63 - 1)
    design: str = key(default="random", choices=DESIGNS)
    curves: int = key(default=3, most=1000)
    approaches: tuple[str, ...] = key(default=("multi-scale",), choices=APPROACHES)
    classical: Classical = key(default=Classical)
    parametric: Design = key(default=Design)
    joint: Design = key(default=Design)
    limit: float = key(
        default=0.5, rule=below(1, "a share of the samples; write a fraction below 1")
    )
    random: dict[str, Distribution] = key(
        default=dict, type=lambda: tables_of_scalars(Distribution)
    )
    roughness: bool = key(default=False, internal=True)

    @property
    def rough(self) -> bool:
        """Whether an approach has rough contact."""
        return not {*ROUGH}.isdisjoint(self.approaches)

    def takes_random(self, approach: str) -> bool:
        """Whether an approach samples [samples.random].

        The multi-scale one does only where no other can: beside parametric or joint it is
        roughness alone.
        """
        if approach == "classical" or not self.random:
            return False
        return approach != "multi-scale" or not {"parametric", "joint"} & {*self.approaches}

    def plan(self, approach: str) -> "Plan":
        """Number and design of an approach's samples as the scene asks for them."""
        table = {"parametric": self.parametric, "joint": self.joint}.get(approach, Design())
        design = table.design or ("rbd-fast" if approach == "parametric" else self.design)
        rough = self.roughness and approach in ROUGH
        return Plan(table.n or self.n, design, table.curves or self.curves, rough)


@dataclass(frozen=True, slots=True)
class Plan:
    """Samples asked for, and how they are laid out.

    Attributes:
        n: their number.
        design: of the random inputs.
        curves: search curves of FAST for each input.
        rough: whether samples draw laws or critical gaps beside the inputs.
    """

    n: int
    design: str
    curves: int
    rough: bool = False

    @property
    def grows(self) -> bool:
        """Whether more samples leave those already there as they are."""
        return self.design in ("random", "sobol")


@dataclass(frozen=True, slots=True)
class Range:
    """[sweep.parameters]: values of the scalar with that dotted key; with its unit.

    Attributes:
        start: first value.
        stop: last value; it may lie below ``start``.
        steps: number of values, equally spaced, both ends included.
        values: list of values, rising or falling, instead of ``start``, ``stop`` and ``steps``.
    """

    start: float | None = key("*", default=None, sign="any")
    stop: float | None = key("*", default=None, sign="any")
    steps: int = key(default=41, most=MAX_STEPS)
    values: tuple[float, ...] = key("*", default=(), sign="any")

    def contradictions(self) -> Iterator[str]:
        """Two values or more, in order."""
        ends = self.start is not None, self.stop is not None
        if any(ends) == bool(self.values) or ends[0] != ends[1]:
            yield ": write start, stop and steps, or values"
        step = np.diff(self.points)
        if not step.size or not (np.all(step > 0) or np.all(step < 0)):
            yield ": two values or more are needed, rising or falling"

    @property
    def points(self) -> tuple[float, ...]:
        """All values, SI."""
        if self.start is None or self.stop is None:
            return self.values
        return tuple(float(x) for x in np.linspace(self.start, self.stop, self.steps))


@dataclass(frozen=True, slots=True)
class Sweep:
    """[sweep]: modes followed over parameters of the scene.

    Attributes:
        parameters: values of one or two scalars, by dotted key; the first one is followed, the
            second one makes a chart.
        samples: rough samples, the first ones of the scene, whose modes are also followed.
    """

    parameters: dict[str, Range] = key(default=dict, type=lambda: tables_of_scalars(Range))
    samples: int = key(default=0, sign="zero")

    @property
    def first(self) -> str:
        """Key of the parameter that modes are followed over."""
        return next(iter(self.parameters))

    @property
    def second(self) -> str | None:
        """Key of the other parameter of a chart."""
        return [*self.parameters, None][1]


def split_key(name: str) -> tuple[str, str, str]:
    """Section, table and key of "section.table.key"; the table's name may hold dots itself."""
    section, _, rest = name.partition(".")
    table, _, last = rest.rpartition(".")
    return section, table.strip('"'), last


def is_constant(name: str) -> bool:
    """Whether a scalar, by its dotted key, is an elastic constant of a material."""
    section, _, last = split_key(name)
    return section == "materials" and last not in ("loss", "rho")


def below_least(name: str, value: float) -> str:
    """What a scalar must be, by its dotted key, where a value is less than that; else ""."""
    last = split_key(name)[2]
    if last.startswith("nu") or last in ("C12", "C13", "C23"):
        return ""
    if last in ("friction", "loss", "alpha", "beta", "mass", "pressure"):
        return "" if value >= 0 else "must be zero or more"
    return "" if value > 0 else "must be positive"


def unit_of(name: str) -> str:
    """SI unit of a scalar of the scene that may be random.

    Raises:
        KeyMistake: no such scalar may be random.
    """
    for table, keys, unit in SCALARS:
        names = keys.replace(".", r"\.").replace(" ", "|")
        if re.fullmatch(re.sub("[A-Z]{3,}", ".+", rf"{table}\.({names})"), name):
            return unit
    part, why = name.startswith("parts."), "one brake has one value of it; others may vary"
    rows = (f"{t}.{keys.replace(' ', '|')}" for t, keys, _ in SCALARS if ("parts." in t) == part)
    text = f"""{"of the parts only these lengths may vary on one brake" if part else why}:
        {", ".join(rows)}; run the scene once for each value, with --set {name}=VALUE, and compare
        the runs"""
    raise KeyMistake(text, name)


def quantities(cls: Any) -> list[str]:
    """Names of the keys of a table that are in the unit of another key of the scene."""
    return [f.name for f in fields(cls) if f.metadata.get("unit") == "*"]


def tables_of_scalars(cls: Any) -> Any:
    """Type of tables by dotted key, whose numbers are in the unit of the scalar of that key.

    Args:
        cls: dataclass of one of them.
    """
    names = quantities(cls)

    def in_si_units(tables: Any) -> Any:
        for name, table in tables.items() if isinstance(tables, dict) else ():
            unit = unit_of(name)
            if unit and isinstance(table, dict):
                numbers = {k: _converted(table[k], unit, name, k) for k in names if k in table}
                tables = {**tables, name: {**table, **numbers}}
        return tables

    return Annotated[value_type(dict[str, cls], {}), BeforeValidator(in_si_units)]


def _converted(value: Any, unit: str, *where: str) -> Any:
    if isinstance(value, list):
        return [_converted(v, unit, *where) for v in value]
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise KeyMistake(str(error), *where) from None


def complete(d: Distribution, name: str, folder: Path) -> Distribution:
    """A law of a random input with the values of its file, checked.

    Args:
        d: the law as the scene writes it, in SI units.
        name: dotted key of the input.
        folder: the scene's folder, where files of measured values are looked for.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    where = f'samples.random."{name}"'
    if d.file is not None:
        values = _measured(d, unit_of(name), folder, where)
        digest = hashlib.sha256(np.array(values).tobytes()).hexdigest()
        d = replace(d, values=values, digest=digest)
    drawn = [v for v in d.values if d.min <= v <= d.max]
    if d.law == "measured" and len(drawn) < 2:
        raise SceneError(f"""{where}: a measured law needs two values or more within min and max, in
            values or file""")
    if name == "motion.speed":
        return d
    least = d.min if d.law == "uniform" and np.isfinite(d.min) else None
    for key_, value in (("mean", d.mean), ("min", least)):
        if value is not None and (text := below_least(name, value)):
            raise SceneError(f"{where}.{key_} = {value:g}: {text}")
    if wrong := [v for v in drawn if below_least(name, v)]:
        raise SceneError(f"""{where}.values: {len(wrong)} of {len(d.values)} measured values
            {below_least(name, min(wrong))}, the least is {min(wrong):g}; correct them, or write
            min, which leaves them out""")
    return d


def _measured(d: Distribution, unit: str, folder: Path, where: str) -> tuple[float, ...]:
    """Numbers of a file in SI units."""
    path = folder / str(d.file)
    at = f"{where}.file = {d.file!r}"
    factor = 1.0
    if unit:
        if d.unit is None:
            raise SceneError(f"{where}.unit: missing; say the unit of the numbers in {d.file}")
        factor = factor_to_si(d.unit, unit, f"{where}.unit = {d.unit!r}")
    with reading(path, "as numbers", at=f"{at}: "):
        if path.suffix == ".npz":
            found = npz_names(path)
            names = found if d.array is None else [d.array]
            if len(names) != 1 or names[0] not in found:
                raise SceneError(f"{at}: contains {', '.join(found)}; name one as array")
            values = np.ravel(read_npz(path, names)[names[0]]).astype(float)
        else:
            values = np.ravel(np.loadtxt(path, ndmin=1))
    if not np.isfinite(values).all():
        raise SceneError(f"{at}: contains values that are not numbers; remove them")
    return tuple(float(v) * factor for v in values)
