"""[samples]: how many, of which approaches, and what is random in them.

A random input is named by the dotted key of the scalar it replaces; its numbers carry that
scalar's unit:

    contact.NAME.friction                       one number, not a table
    loads.FACE.pressure
    materials.NAME.CONSTANT                     a stiffness (C11, ...) where the table is written by
        stiffnesses; or an engineering constant: E, nu of an isotropic material, E_1, E_2, E_3,
        nu_12, nu_31, nu_32, G_12, G_13, G_23 of any other one, however its table is written. The
        named ones change, the others of this list stay.
    materials.NAME.loss, materials.NAME.rho
    masses.FACE.mass
    parts.NAME.lining, .plate, .shim            thickness of the layers of a pad
    parts.NAME.thickness, parts.NAME.height     of a disc, of a block
    parts.NAME.slot_depth, .chamfer_depth       of a pad
    parts.NAME.cheek, .hat, .flange             of a disc
    parts.NAME.chamfer, .slot                   of a pad, its contact elements move along
    parts.NAME.length, .width, .radius, .bore   of a block, of a disc, likewise
    parts.NAME.layers.LAYER                     of a layer of the mesh file
    parts.NAME.morph.LENGTH.value               that moves nodes of the mesh file
    stability.damping.rayleigh.alpha, .beta
    motion.speed                                rad/s or m/s, as the scene's motion says
    samples.classical.penalty                   in approaches of perfect contact
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import npz_names, read_npz, reading
from brake_fenicsx.scene.keys import KeyMistake, below, key, value_type
from brake_fenicsx.scene.units import factor_to_si, to_si

APPROACHES = ("multi-scale", "classical", "parametric", "joint")
ROUGH = ("multi-scale", "joint")  # of rough contact
NO_ROUGH_SAMPLES = "there are no rough samples; name multi-scale or joint in samples.approaches"
DESIGNS = ("random", "latin-hypercube", "sobol", "fast", "rbd-fast", "saltelli")
DISTRIBUTIONS = ("normal", "lognormal", "uniform", "measured")
# Keys of the scalars that may take other values than the scene's, and their SI units.
SCALARS = (
    (r"contact\..+\.friction", ""),
    (r"loads\..+\.pressure", "Pa"),
    (r"materials\..+\.(loss|nu|nu_\d\d)", ""),
    (r"materials\..+\.(E|E_\d|G_\d\d|C\d\d)", "Pa"),
    (r"materials\..+\.rho", "kg/m^3"),
    (r"masses\..+\.mass", "kg"),
    (r"motion\.speed", "rad/s or m/s"),
    (r"parts\..+\.(lining|plate|shim|slot_depth|chamfer_depth|layers\.\w+|morph\.\w+\.value)", "m"),
    (r"parts\..+\.(thickness|cheek|hat|flange|height)", "m"),
    (r"parts\..+\.(chamfer|slot|length|width|radius|bore)", "m"),
    (r"samples\.classical\.penalty", "Pa/m"),
    (r"stability\.damping\.rayleigh\.alpha", "1/s"),
    (r"stability\.damping\.rayleigh\.beta", "s"),
)
ENGINEERING = ("E_1", "E_2", "E_3", "nu_12", "nu_31", "nu_32", "G_12", "G_13", "G_23")
INFINITY = float("inf")


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
    correlation: dict[str, float] = field(default_factory=dict, metadata={"sign": "any"})
    digest: str = key(default="", internal=True)


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
    classical: Classical = field(default_factory=Classical)
    parametric: Design = field(default_factory=Design)
    joint: Design = field(default_factory=Design)
    limit: float = key(
        default=0.5, rule=below(1, "a share of the samples; write a fraction below 1")
    )
    random: dict[str, Distribution] = field(
        default_factory=dict, metadata={"type": lambda: _random_type()}
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

    def plan(self, approach: str) -> Plan:
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
        return "must be zero or more" if value < 0 else ""
    return "" if value > 0 else "must be positive"


def unit_of(name: str) -> str:
    """SI unit of a scalar of the scene that may be random.

    Raises:
        KeyMistake: no such scalar may be random.
    """
    for pattern, unit in SCALARS:
        if re.fullmatch(pattern, name):
            return unit
    if split_key(name)[0] == "parts":
        raise KeyMistake(
            "of the parts only these lengths may vary on one brake: lining, plate, shim,"
            " slot, slot_depth, chamfer and chamfer_depth of a pad, thickness, cheek, hat, flange,"
            " radius and bore of a disc, length, width and height of a block, layers.LAYER of a"
            " mesh file and morph.LENGTH.value of a displaced mesh; run the scene once for"
            f" each value, with --set {name}=VALUE, and compare the runs", name,
        )  # fmt: skip
    raise KeyMistake(
        "one brake has one value of it: run the scene once for each, with --set, and compare the"
        " runs; others may vary: contact.NAME.friction, loads.FACE.pressure,"
        " materials.NAME.CONSTANT, .loss and .rho, masses.FACE.mass, parts.NAME.THICKNESS,"
        " stability.damping.rayleigh.alpha and .beta, motion.speed, samples.classical.penalty",
        name,
    )  # fmt: skip


def in_si_units(tables: Any, names: Sequence[str]) -> Any:
    """Numbers of tables named by dotted keys in the unit of the scalar that each is about.

    Args:
        tables: dotted key -> table.
        names: its keys that are values of that scalar.

    Raises:
        KeyMistake: no such scalar may take other values than the scene's, or a unit is wrong.
    """
    if not isinstance(tables, dict):
        return tables
    out = {}
    for name, table in tables.items():
        unit, out[name] = unit_of(name), table
        if isinstance(table, dict) and unit:
            out[name] = {
                k: _converted(v, unit, name, k) if k in names else v for k, v in table.items()
            }
    return out


def _converted(value: Any, unit: str, *where: str) -> Any:
    if isinstance(value, list):
        return [_converted(v, unit, *where) for v in value]
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise KeyMistake(str(error), *where) from None


def _random_type() -> Any:
    convert = partial(in_si_units, names=("mean", "sd", "min", "max", "values"))
    return Annotated[value_type(dict[str, Distribution], {}), BeforeValidator(convert)]


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
    for text in _mistakes(d):
        raise SceneError(f"{where}{text}")
    if name == "motion.speed":
        return d
    for key_, value in (("mean", d.mean), ("min", _uniform(d))):
        if value is not None and (text := below_least(name, value)):
            raise SceneError(f"{where}.{key_} = {value:g}: {text}")
    wrong = [v for v in d.values if d.min <= v <= d.max and below_least(name, v)]
    if wrong:
        raise SceneError(f"""{where}.values: {len(wrong)} of {len(d.values)} measured values
            {below_least(name, min(wrong))}, the least is {min(wrong):g}; correct them, or write
            min, which leaves them out""")
    return d


def _uniform(d: Distribution) -> float | None:
    """Lower end of a uniform law that has one."""
    return d.min if d.law == "uniform" and np.isfinite(d.min) else None


def _mistakes(d: Distribution) -> Iterator[str]:
    """What each law needs."""
    bounds = np.isfinite([d.min, d.max])
    if not d.min < d.max:
        yield f": min = {d.min:g} must lie below max = {d.max:g}"
    if d.law in ("normal", "lognormal") and None in (d.mean, d.sd):
        yield f": a {d.law} law needs mean and sd"
    if d.law == "lognormal" and d.mean is not None and d.mean <= 0:
        yield f".mean = {d.mean:g}: a lognormal law needs a positive mean"
    if d.law == "uniform" and d.spread is None and not bounds.all():
        yield ": a uniform law needs min and max, or spread"
    if d.spread is not None and (d.law != "uniform" or bounds.any()):
        yield ".spread: only for a uniform law, in place of min and max"
    if d.law == "measured" and sum(d.min <= v <= d.max for v in d.values) < 2:
        yield ": a measured law needs two values or more within min and max, in values or file"
    if d.law != "measured" and (d.values or d.file):
        yield ': values and file belong to law = "measured"'


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
