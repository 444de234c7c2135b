"""Values of a sample: every scalar of the scene that is random or swept, once.

All that differs from the scene in a sample follows from one mapping, dotted key -> SI value: the
stiffness of its materials, its lengths, masses and loads, its friction.

Laws of random inputs give values by their quantiles, from a point of the unit interval. Cutting at
min and max shrinks the interval of probabilities, so that no point is wasted and a design keeps its
structure.

The scalars that bodies depend on lie, for nearly all samples, in a box that their distributions and
the values of a sweep span; the reduced model is interpolated over it.
"""

from collections.abc import Mapping
from functools import cached_property
from itertools import product

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike
from scipy import special

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import InaccurateResult, SceneError, located
from brake_fenicsx.extensions import InputLaw
from brake_fenicsx.macro.material import Material
from brake_fenicsx.scene import Distribution, Scene, scalars, units
from brake_fenicsx.scene.samples_section import Range, below_least, is_constant, split_key, unit_of

from .material_table import by_material, nominal_value, stiffness, varied_stiffness

# Probability of a constant beyond either end of the box, and how far from its centre, in half
# widths, a sample may lie and still be taken.
TAIL, BEYOND = 1e-3, 1.1


class Values(dict[str, float]):
    """Scalars that differ from the scene, by dotted key, SI.

    Attributes:
        scene: the scene.
    """

    def __init__(self, scene: Scene, given: Mapping[str, float] | None = None):
        """Take the scalars that are given; all others have the scene's value."""
        super().__init__(given or {})
        self.scene: Scene = scene

    @classmethod
    def of(cls, scene: Scene, given: Mapping[str, float]) -> "Values":
        """Some scalars as values, whose materials are computed once."""
        return given if isinstance(given, cls) else cls(scene, given)

    def value(self, name: str) -> float:
        """A scalar of the sample, or of the scene, SI."""
        return self[name] if name in self else nominal_value(self.scene, name)

    def ratio(self, name: str) -> float:
        """A scalar of the sample over that of the scene."""
        return self[name] / nominal_value(self.scene, name) if name in self else 1.0

    @cached_property
    def materials(self) -> dict[str, Array]:
        """Stiffness of each changed material in its own axes [Pa], shape (6, 6)."""
        tables = self.scene.materials
        return {m: varied_stiffness(tables[m], own) for m, own in by_material(self).items()}

    def stiffness(self, material: str) -> Array:
        """Stiffness of a material in its own axes [Pa], shape (6, 6)."""
        found = self.materials.get(material)
        return stiffness(self.scene.materials[material]) if found is None else found

    def moved(self, material: str, ij: tuple[int, int]) -> float:
        """C_ij of a material less that in the scene [Pa]."""
        if material not in self.materials:
            return 0.0
        return float((self.materials[material] - stiffness(self.scene.materials[material]))[ij])

    @property
    def pressures(self) -> Array:
        """Pressures of the loads [Pa], 1 of a force or a displacement, in the order of the names.

        Shape (loads,).
        """
        own = {split_key(n)[1]: v for n, v in self.items() if split_key(n)[0] == "loads"}
        loads = sorted(self.scene.loads.items())
        return np.array([own.get(face, load.size) for face, load in loads])

    def check(self) -> None:
        """Refuse values that no brake has.

        Raises:
            SceneError: the key and its value, or the material.
        """
        for name, value in self.items():
            if isinstance(value, str):
                raise SceneError(f"{name} = {value!r}: write a number, in SI units")
            if is_constant(name):
                continue
            wrong = below_least(name, value)
            if name == scalars.SPEED:
                same = value * nominal_value(self.scene, name) > 0
                wrong = "" if same else "must not be zero, and have the scene's sign"
            if wrong:
                raise SceneError(f"{name} = {value:g}: {wrong}")
        for material, constants in by_material(self).items():
            table = self.scene.materials[material]
            with located(f"materials.{material}"):
                Material(varied_stiffness(table, constants), table.rho)


def quantile(d: Distribution | InputLaw, u: ArrayLike, nominal: float = np.nan) -> Array:
    """Values of a law at some probabilities.

    Args:
        d: the law, in SI units, or one of a user's own.
        u: probabilities, in [0, 1].
        nominal: the value in the scene, which ``spread`` refers to, SI.

    Returns:
        Values, same shape.
    """
    u = np.asarray(u, float)
    if not isinstance(d, Distribution):
        return d.quantile(u, nominal)
    if d.law == "uniform":
        low, high = d.min, d.max
        if d.spread is not None:
            low, high = nominal * (1 - d.spread), nominal * (1 + d.spread)
        return np.asarray(low + u * (high - low))
    if d.law == "measured":
        values = np.sort([v for v in d.values if d.min <= v <= d.max])
        return values[np.minimum((u * values.size).astype(int), values.size - 1)]
    if d.mean is None or d.sd is None:
        raise SceneError(f"samples.random: a {d.law} law needs mean and sd")
    if d.law == "normal":
        return d.mean + d.sd * _normal(u, (d.min - d.mean) / d.sd, (d.max - d.mean) / d.sd)
    # Mean and standard deviation of the logarithm from those of the value.
    variance = np.log1p((d.sd / d.mean) ** 2)
    sd = np.sqrt(variance)
    low, high = np.log(d.min) if d.min > 0 else -np.inf, np.log(d.max)
    mean = np.log(d.mean) - 0.5 * variance
    return np.asarray(np.exp(mean + sd * _normal(u, (low - mean) / sd, (high - mean) / sd)))


def _normal(u: Array, low: float, high: float) -> Array:
    """Quantiles of the standard normal law between two bounds."""
    if low > 0:
        # Probabilities next to 1 have no digits left; those next to 0 have.
        return -_normal(1 - u, -high, -low)
    first, last = special.ndtr(low), special.ndtr(high)
    return np.asarray(special.ndtri(first + u * (last - first)))


class Box:
    """The box that the scalars of the bodies of nearly all samples, and of a sweep, lie in.

    Moduli E enter as E^-1/2, between the bending of layers, which goes with 1/E, and the
    indentation of a transversely isotropic half-space, which goes with the root of a product of
    moduli: one degree less than with 1/E reaches the same error, two less than with E. Lengths
    h enter as ln h, between compression, which goes with h, and bending, with h^-3: on a block over
    a factor of two the largest error is 9e-5 so, 2.5e-3 with h, 1.1e-3 with 1/h.
    """

    def __init__(self, scene: Scene):
        """Span the box by the distributions and the swept values of the scalars."""
        self._scene = scene
        self.names: list[str] = [n for n in scene.varied if scalars.changes_bodies(scene, n)]
        ends = []
        for name in self.names:
            values = [_scaled(name, v) for v in _spanning(scene, name)]
            ends.append((min(values), max(values)))
        box: Array = np.array(ends).reshape(-1, 2)
        self.low: Array = box[:, 0]
        self.high: Array = box[:, 1]

    def point(self, drawn: Mapping[str, float]) -> Array:
        """A sample's point of [-1, 1]^d; scalars that are not drawn have the scene's value."""
        every = Values.of(self._scene, drawn)
        values = [_scaled(n, every.value(n)) for n in self.names]
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        return np.asarray((2 * np.array(values) - self.low - self.high) / width)

    def holds(self, drawn: Mapping[str, float]) -> bool:
        """Whether a sample lies in the box or hardly beyond it."""
        return bool(np.all(np.abs(self.point(drawn)) <= BEYOND))

    def span(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a scalar that samples are taken with, the scene's too."""
        i, usual = self.names.index(name), nominal_value(self._scene, name)
        beyond = 0.5 * (BEYOND - 1) * (self.high[i] - self.low[i])
        ends = [_unscaled(name, v) for v in (self.low[i] - beyond, self.high[i] + beyond)]
        return min(*ends, usual), max(*ends, usual)

    def part(self, name: str, share: float) -> tuple[float, float]:
        """Ends of a part of the range of a scalar, SI: about its middle, or as near as may be.

        The range of a sweep has the scene's own value in it.
        """
        i, middle = self.names.index(name), 0.0
        if self._scene.sweep is not None:
            middle = float(np.clip(0.0, *(self.point({})[i] + share * np.array([-1.0, 1.0]))))
        axis = np.eye(len(self.names))[i]
        ends = [self.values((middle + side) * axis)[name] for side in (-share, share)]
        return min(ends), max(ends)

    def values(self, x: Array) -> dict[str, float]:
        """The scalars at a point of the box, SI."""
        scaled = 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * x
        return {n: _unscaled(n, v) for n, v in zip(self.names, scaled, strict=True)}

    def materials(self, x: Array) -> dict[str, Array]:
        """Stiffness of the materials at a point of the box [Pa], each of shape (6, 6)."""
        return Values(self._scene, self.values(x)).materials


def softening(box: Box) -> float:
    """Least r with K(x) >= r K(0) at any one thickness, as quadratic forms: of the C(x).

    Raises:
        InaccurateResult: a material is not positive definite at the centre of the box or a corner.
    """
    centre, least = np.zeros(len(box.names)), 1.0
    corners = product(*((-1.0, 1.0) if is_constant(n) else (0.0,) for n in box.names))
    usual = _definite(box, centre)
    for corner in corners:
        for name, C in _definite(box, np.array(corner)).items():
            least = min(least, float(la.eigvalsh(C, usual[name])[0]))
    return least


def _definite(box: Box, x: Array) -> dict[str, Array]:
    """Stiffness of the materials at a point of the box, all positive definite."""
    found = box.materials(x)
    for name, C in found.items():
        if not la.eigvalsh(C)[0] > 0:
            own = (n for n in box.names if split_key(n)[1] == name)
            values = ", ".join(f"{n} = {_text(n, box.values(x)[n])}" for n in own)
            raise InaccurateResult(f"""materials.{name} is not positive definite everywhere in the
                range of its values, with {values} for example; narrow the range""")
    return found


def check_box(scene: Scene) -> None:
    """Refuse ranges of random and swept scalars that hold no material or no length.

    Raises:
        SceneError: the key and the remedy.
    """
    stability = scene.stability if "stability" in scene.stages else None
    with located(scene.file):
        box = Box(scene)
        if stability and (stability.method, stability.on_tolerance) == ("reduced", "warn"):
            with located('stability.method = "reduced"', InaccurateResult):
                softening(box)


def _spanning(scene: Scene, name: str) -> list[float]:
    """Values of a scalar that lie in the box; a sweep has the scene's own brake in it too."""
    law, nominal = scene.samples.random.get(name), nominal_value(scene, name)
    values: list[float] = []
    if law is not None:
        values += map(float, quantile(law, [TAIL, 1 - TAIL], nominal))
    if scene.sweep is not None:
        values += [nominal, *scene.sweep.parameters.get(name, Range()).points]
    if name in scene.spanned:  # at each of its values the sample scatters as about the scene's
        scatter = values or [nominal]
        values += [x * v / nominal for x in scene.spanned[name] for v in scatter] + [nominal]
    least = min(values)
    possible = least >= 0 if name.endswith(".mass") else least > 0
    if not possible and (scalars.is_length(name) or scalars.is_inertia(name) or _is_modulus(name)):
        where = 'samples.random."{}"' if law is not None else 'sweep.parameters."{}"'
        raise SceneError(f"""{where.format(name)}: the law reaches {_text(name, least)} with a
            probability of {TAIL:g}; write a positive min, or a smaller sd""")
    return values


def _text(name: str, value: float) -> str:
    """Three digits of a scalar, in its usual unit."""
    return units.quantity_text(float(f"{value:.3g}"), unit_of(name))


def _scaled(name: str, value: float) -> float:
    """E^-1/2 of a modulus, the logarithm of a thickness, any other constant itself."""
    if scalars.is_length(name):
        return float(np.log(value))
    return value**-0.5 if _is_modulus(name) and value > 0 else value


def _unscaled(name: str, value: float) -> float:
    """The constant of a scaled value."""
    if scalars.is_length(name):
        return float(np.exp(value))
    return value**-2.0 if _is_modulus(name) and value > 0 else value


def _is_modulus(name: str) -> bool:
    """Whether a constant is positive: E, G, or on the diagonal of the stiffness."""
    constant = split_key(name)[2]
    return constant[0] in "EG" or (constant[0] == "C" and constant[1] == constant[2])
