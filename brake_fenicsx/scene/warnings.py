"""Values that are allowed and yet unusual: mostly a slip of the unit, a line each."""

from collections.abc import Iterator, Mapping
from dataclasses import fields
from statistics import NormalDist
from typing import Any

from brake_fenicsx.errors import lines

from .contact_section import ContactTable
from .keys import dotted, walk
from .parts_section import Load, MaterialTable, longest_length
from .samples_section import Classical, Distribution, split_key
from .scene import Scene
from .units import MODULI, quantity_text, with_unit

METAL_DENSITY, METAL_MODULUS = 4000.0, 5e9  # kg/m^3, Pa: above the one, below the other is no metal
CUT = 0.01  # share of a normal law below zero that is worth a warning
LENGTHS = (10e-3, 1.0)  # m: longest length of a part


@lines
def unusual(scene: Scene) -> Iterator[str]:
    """Numbers of a scene outside the band of usual ones: key, value, band."""
    for rule in (_bands, _random, _designs, _hardness, _metals, _lengths):
        yield from rule(scene)


def _bands(scene: Scene) -> Iterator[str]:
    """All numbers that have a band."""
    for keys, about, value in walk(scene):
        yield from _outside(keys, about, value)


def _random(scene: Scene) -> Iterator[str]:
    """Numbers of random inputs, which have the band of the key they replace."""
    kinds = (ContactTable, Load, MaterialTable, Classical)
    about: dict[str, Mapping[str, Any]] = {f.name: f.metadata for c in kinds for f in fields(c)}
    for name, law in scene.samples.random.items():
        _, _, last = split_key(name)
        scalar = about.get(last) or about.get(last.partition("_")[0], {})
        for word in ("mean", "min", "max", "values"):
            numbers = getattr(law, word, None)
            yield from _outside(("samples", "random", name, word), scalar, numbers)
        if isinstance(law, Distribution):  # a law of one's own says nothing of its draws
            yield from _doubtful(name, law, scalar.get("sign") == "any")


def _designs(scene: Scene) -> Iterator[str]:
    """Designs that do not give what they are known for, and more checks than samples."""
    plans = {name: scene.samples.plan(name) for name in scene.samples.approaches}
    for name in filter(scene.samples.takes_random, plans):
        if plans[name].rough and plans[name].design == "fast":
            yield f"""samples: design = "fast" of {name}: no total indices, because every sample
                draws its roughness anew; design = "saltelli" gives them, and those of the
                roughness"""
    count = max(plan.n for plan in plans.values())
    if scene.stability and scene.stability.verify > count:
        yield f"""stability.verify = {scene.stability.verify}: there are {count} samples, all of
            which are then verified"""


def _hardness(scene: Scene) -> Iterator[str]:
    """A lining that yields beyond its modulus."""
    micro = scene.micro
    if micro and micro.hardness and micro.hardness > (E_star := micro.E / (1 - micro.nu**2)):
        yield f"""micro.hardness = {with_unit(micro.hardness, "Pa")}: above E* = E / (1 - nu^2) =
            {quantity_text(E_star, "Pa")} of the lining, where solids yield at a tenth of it and
            less; correct micro.E or the hardness"""


def _metals(scene: Scene) -> Iterator[str]:
    """Densities of metals with moduli of other materials."""
    for name, table in scene.materials.items():
        modulus = min(v for v in (*_flat(table.E), *_flat(table.C11), METAL_MODULUS))
        if table.rho > METAL_DENSITY and MODULI[0] <= modulus < METAL_MODULUS:
            yield f"""{dotted("materials", name)}: rho = {table.rho:g} kg/m^3 is that of a metal, a
                modulus of {with_unit(modulus, "Pa")} is not, whose are
                {with_unit(METAL_MODULUS, "Pa")} at least; correct the unit if it is wrong"""


def _lengths(scene: Scene) -> Iterator[str]:
    """The longest length of each part."""
    band = {"unit": "m", "band": LENGTHS}
    for name, part in scene.parts.items():
        if part.parameters is not None:
            key, length = longest_length(part.parameters)
            yield from _outside(("parts", name, key), band, length)


def _doubtful(name: str, law: Distribution, signed: bool) -> Iterator[str]:
    """Draws that the law itself cuts off, and values that do not differ."""
    where = dotted("samples", "random", name)
    if law.law == "normal" and law.mean and law.sd and law.mean > 0.0 >= law.min and not signed:
        share = NormalDist(law.mean, law.sd).cdf(0.0)
        if share > CUT:
            yield f"""{where}: {100 * share:.2g} % of a normal law of mean {law.mean:g} and sd
                {law.sd:g} are negative, which this input cannot be; take law = "lognormal" or a
                smaller sd"""
    if law.law == "measured" and len({*law.values}) == 1:
        yield f"{where}: all measured values are equal; nothing is random"


def _outside(keys: tuple[str, ...], about: Mapping[str, Any], value: Any) -> Iterator[str]:
    low, high = about.get("band", (-float("inf"), float("inf")))
    for v in _flat(value):
        if abs(v) < float("inf") and not low <= v <= high:
            number, least, most = (with_unit(float(x), about["unit"]) for x in (v, low, high))
            yield f"""{dotted(*keys)} = {number}: unusual, not between {least} and {most};
                {"correct the unit if it is wrong" if about["unit"] else "check the value"}"""


def _flat(value: Any) -> Iterator[float]:
    for v in value if isinstance(value, tuple) else (value,):
        if isinstance(v, float | int) and not isinstance(v, bool):
            yield v
