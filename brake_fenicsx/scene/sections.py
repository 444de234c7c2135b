"""The sections of a scene: frozen settings in SI units.

Every key is a field of a dataclass here, or of a builder in ``geometry``; its metadata says the
unit ("unit"), the allowed sign ("sign": positive if absent, "zero", "any") and the choices
("choices"). What a scene does not name is None, and is neither built, assembled nor imported.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, WithJsonSchema

from brake_fenicsx.scene.countermeasures import Countermeasure
from brake_fenicsx.scene.damping import Damping
from brake_fenicsx.scene.mesh import MeshTable
from brake_fenicsx.scene.parts import Part, parts_type
from brake_fenicsx.scene.samples import Samples
from brake_fenicsx.scene.sweep import Sweep
from brake_fenicsx.scene.tables import key
from brake_fenicsx.scene.units import to_si

Array = NDArray[np.float64]

DIRECTIONS = ("x", "y", "z")
STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")
LAWS = '"library", { linear = "2e13 Pa/m" }, { p0 = .., u0 = .. } or { table = .., units = .. }'

# Bands of usual values: rubber to diamond [Pa]; friction.
MODULI = (1e6, 2e12)
FRICTION = (0.0, 1.5)


@dataclass(frozen=True, slots=True)
class Statistics:
    """[surface.statistics]: a surface known by its numbers alone.

    Attributes:
        S_q: root mean square of the heights.
        S_sk: skewness of the heights.
        S_ku: kurtosis of the heights; 3 for a Gaussian surface.
        c1: slope of the power spectrum below ``q_c``.
        c2: slope above it.
        q_c: wave number of the crossover.
    """

    S_q: float = key("m", band=(1e-9, 1e-3))
    S_sk: float = key(default=0.0, sign="any")
    S_ku: float = key(default=3.0)
    c1: float = key(default=-2.0, sign="any")
    c2: float = key(default=-4.5, sign="any")
    q_c: float = key("1/m", default=30e3)


@dataclass(frozen=True, slots=True)
class Surface:
    """[surface]: the scan, or statistics in its place.

    Attributes:
        scan: file of the scan, relative to the scene's folder: npz, text, or an instrument's; or a
            list of several scans of one pad with the same pixels, of which spectrum and variance
            are averaged and heights pooled. The other keys apply to each scan. An npz contains
            ``heights`` and ``size`` in metres ([own scan](own_scan_own_mesh.md)).
        level: what is subtracted from the heights: nothing, a plane, or a second-order surface.
        size: lengths of the scan's sides, if the file does not contain them.
        height_unit: unit of the heights, if the file does not contain it ("um").
        rows: coordinate that changes from one row of a table of heights to the next; "y" as in an
            image. In a text whose header gives the sides, x is the width.
        statistics: statistics instead of a scan.
        form: file of a longer, coarser scan of the face, for the waves longer than ``scan``; the
            file must contain size and units (npz, or an instrument's).
        cutoff: shortest wavelength the instrument resolves; it limits the spectrum and with it the
            artificial surfaces, and filters no height; two pixels if not given, or if longer.
        spectrum: spectrum of the artificial surfaces: that of the scan, or its bi-fractal fit.
        low: spectrum below the scan's lowest wave number: constant, or the power law extrapolated.
        S_q: variance of the artificial surfaces: from the scan's spectrum on a patch, or equal to
            the variance of the scan, to which the spectrum is scaled (as in the paper).
        distribution: shape of the height distribution of the artificial surfaces: the measured
            heights, Johnson's distribution of the same four moments, or the normal one; measured
            for a scan and johnson for statistics if not given.
    """

    scan: str | tuple[str, ...] | None = key(default=None)
    level: str = key(default="plane", choices=("none", "plane", "second-order"))
    size: tuple[float, ...] | None = key("m", default=None)
    height_unit: str | None = key(default=None)
    statistics: Statistics | None = None
    rows: str = key(default="x", choices=("x", "y"))
    form: str | None = key(default=None)
    cutoff: float | None = key("m", default=None)
    spectrum: str = key(default="measured", choices=("fit", "measured"))
    low: str = key(default="flat", choices=("flat", "extend"))
    S_q: str = key(default="spectrum", choices=("spectrum", "scan"))
    distribution: str | None = key(default=None, choices=("measured", "johnson", "normal"))

    @property
    def scans(self) -> tuple[str, ...]:
        """Files of the scans; none where there are statistics in their place."""
        return (self.scan,) if isinstance(self.scan, str) else self.scan or ()


@dataclass(frozen=True, slots=True)
class Micro:
    """[micro]: artificial patches and their contact.

    Attributes:
        patch: side of the square patch; "mesh": that of the mean contact element.
        pixels: points along a side; "scan": as many as resolve the wavelengths that the scan
            measured reliably.
        boundary: half-space without neighbours, or periodic.
        laws: number of laws in the library.
        E: Young's modulus of the lining across the surface.
        nu: Poisson's ratio of the lining, which belongs to ``E``; E* = E / (1 - nu^2).
        tolerance: largest duality gap of a contact solution, relative to the work done.
        max_pressure: highest mean pressure of a law, relative to E*; 0.1 if not given, and no more
            than a tenth of the hardness.
        steps: load steps of a law, equal in log load.
        bulk_compliance: whether a law keeps the compliance of the half-space, which the
            finite-element lining already has.
        seed: seed of the artificial surfaces.
        scans: scans of the same surface that are drawn anew for the band of the stiffness that the
            page states; 0: no band.
        hardness: pressure at which a point yields; elastic at any pressure if not given, as in
            the paper.
    """

    patch: Literal["mesh"] | float = key("m", default=2.825e-3, band=(1e-5, 0.05))
    pixels: int | Literal["scan"] = key(default="scan")
    boundary: str = key(default="free", choices=("free", "periodic"))
    laws: int = key(default=100)
    E: float = key("Pa", default=1983.3e6, band=MODULI)
    nu: float = key(default=0.4054, sign="any")
    tolerance: float = key(default=1e-6)
    max_pressure: float | None = key(default=None)
    steps: int = key(default=40)
    bulk_compliance: str = key(default="remove", choices=("remove", "keep"))
    seed: int = key(default=1, sign="zero")
    scans: int = key(default=20, sign="zero")
    hardness: float | None = key("Pa", default=None, band=(1e6, 2e10))


def _held(value: Any) -> Any:
    """Directions held by a support."""
    if value == "clamped":
        return DIRECTIONS
    if isinstance(value, list) and value and all(v in DIRECTIONS for v in value):
        return value
    raise ValueError('write "clamped" or a list of "x", "y", "z"')


def _supports_type() -> Any:
    """Type of [supports]: the directions that each holds."""
    some = {"type": "array", "items": {"enum": [*DIRECTIONS]}, "minItems": 1}
    schema = WithJsonSchema({"anyOf": [{"const": "clamped"}, some]})
    return dict[str, Annotated[tuple[str, ...], BeforeValidator(_held), schema]]


@dataclass(frozen=True, slots=True)
class MaterialTable:
    """[materials.NAME]: engineering constants or stiffnesses of the chosen model.

    Attributes:
        model: symmetry; which constants it takes: [meshes.md](meshes.md).
        rho: density.
        E: Young's modulus, or one for each axis.
        nu: Poisson's ratio, or one for each pair of axes.
        G: shear modulus, or one for each pair of axes.
        C11: stiffness, in place of engineering constants.
        C22: likewise.
        C33: likewise.
        C12: likewise.
        C13: likewise.
        C23: likewise.
        C44: likewise, shear 23.
        C55: likewise, shear 13.
        C66: likewise, shear 12.
        axis: additional rotation of axis 1, relative to axis 1 of the part.
        loss: loss factor.
    """

    model: str = key(choices=("isotropic", "transversely-isotropic", "orthotropic", "cubic"))
    rho: float = key("kg/m^3", band=(100.0, 25e3))
    E: float | tuple[float, ...] | None = key("Pa", default=None, band=MODULI)
    nu: float | tuple[float, ...] | None = key(default=None, sign="any")
    G: float | tuple[float, ...] | None = key("Pa", default=None, band=MODULI)
    C11: float | None = key("Pa", default=None, band=MODULI)
    C22: float | None = key("Pa", default=None, band=MODULI)
    C33: float | None = key("Pa", default=None, band=MODULI)
    C12: float | None = key("Pa", default=None, sign="any")
    C13: float | None = key("Pa", default=None, sign="any")
    C23: float | None = key("Pa", default=None, sign="any")
    C44: float | None = key("Pa", default=None, band=MODULI)
    C55: float | None = key("Pa", default=None, band=MODULI)
    C66: float | None = key("Pa", default=None, band=MODULI)
    axis: float = key("rad", default=0.0, sign="any")
    loss: float = key(default=0.0, sign="zero", band=(0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Law:
    """[contact.NAME.law]: one law for all contact elements in place of "library".

    Attributes:
        linear: stiffness of a linear penalty, p = linear * penetration.
        p0: pressure at zero gap of an exponential law, p = p0 exp(-g / u0).
        u0: decay length of the exponential law.
        table: file of a measured law, in two columns: gap and pressure.
        units: units of these columns.
        steps: gaps, falling, and pressures of the table.
    """

    linear: float | None = key("Pa/m", default=None, band=(1e9, 1e17))
    p0: float | None = key("Pa", default=None, band=(1e3, 1e11))
    u0: float | None = key("m", default=None, band=(1e-9, 1e-3))
    table: str | None = None
    units: tuple[str, ...] = ()
    steps: tuple[tuple[float, ...], ...] = key(default=(), internal=True)


@dataclass(frozen=True, slots=True)
class Friction:
    """[contact.NAME.friction]: kinetic + (static - kinetic) exp(-V / decay) at sliding speed V.

    Attributes:
        static: coefficient at rest.
        kinetic: coefficient at high speed.
        decay: decay constant of the coefficient over the speed.
    """

    static: float = key(sign="zero", band=FRICTION)
    kinetic: float = key(sign="zero", band=FRICTION)
    decay: float = key("m/s")

    def coefficient(self, V: Array) -> tuple[Array, Array]:
        """Coefficient mu [-] and mu'(V) [s/m] at speeds V [m/s], each of the shape of V."""
        fall = (self.static - self.kinetic) * np.exp(-np.asarray(V, float) / self.decay)
        return np.asarray(self.kinetic + fall, float), np.asarray(-fall / self.decay, float)


@dataclass(frozen=True, slots=True)
class Zone:
    """[contact.NAME.zone]: contact elements whose centre lies in all ranges named, [low, high).

    Attributes:
        radius: distance from the z axis.
        angle: angle about z, from x towards y; a range may go beyond 180 deg.
        x: coordinate.
        y: coordinate.
        z: coordinate.
    """

    radius: tuple[float, ...] | None = key("m", default=None, sign="zero")
    angle: tuple[float, ...] | None = key("rad", default=None, sign="any")
    x: tuple[float, ...] | None = key("m", default=None, sign="any")
    y: tuple[float, ...] | None = key("m", default=None, sign="any")
    z: tuple[float, ...] | None = key("m", default=None, sign="any")


@dataclass(frozen=True, slots=True)
class Contact:
    """[contact.NAME]: an interface between two faces.

    Attributes:
        faces: two faces "part.face", the pad's first.
        law: "library": laws of the rough surface; or a table.
        discretisation: kind of contact element: a facet, a Gauss point, or a node
            ([contact.md](contact.md)).
        gap: critical gap of every element: none, drawn from the height distribution (as in the
            paper), or the waviness of the face, its waves longer than a patch
            ([contact.md](contact.md)).
        friction: friction coefficient, or a table if it depends on the speed.
        friction_in_equilibrium: whether friction also acts in the equilibrium.
        search: largest gap at which facets are paired; the largest facet if not given.
        zone: part of the faces that the interface is restricted to; all of them if not given.
        slip: "motion": the faces slide along the scene's motion; "stuck": they do not slide
            ([contact.md](contact.md#faces-that-stick)).
        tangential_stiffness: tangential stiffness of faces that stick, equal in all tangential
            directions; required with ``slip = "stuck"``.
    """

    faces: tuple[str, ...]
    law: Literal["library"] | Law = key(default="library", write=LAWS)  # noqa: RUF009
    discretisation: str = key(default="patch", choices=("patch", "quadrature", "node"))
    gap: str = key(default="none", choices=("none", "hdf", "waviness"))
    friction: float | Friction = key(default=0.0, sign="zero", band=FRICTION)  # noqa: RUF009
    friction_in_equilibrium: bool = True
    search: float | None = key("m", default=None)
    zone: Zone | None = None
    slip: str = key(default="motion", choices=("motion", "stuck"))
    tangential_stiffness: float | None = key("Pa/m", default=None, band=(1e9, 1e17))


@dataclass(frozen=True, slots=True)
class Load:
    """[loads]: loads on a face, by its name "part.face".

    Attributes:
        pressure: the pressure, towards the body.
        force: total force, along axes 1 and 2 of the part and along z, spread evenly over the area.
        moment: total moment about axes through the area's centroid, parallel to axes 1 and 2 of the
            part and z, distributed linearly over the area.
        displacement: imposed displacement of a face that is supported in these directions; the face
            is also fixed in the modes: ``{ z = "-0.1 mm" }``.
        steps: equal load steps, taken only if the full load at once does not converge.
    """

    pressure: float | None = key("Pa", default=None, band=(1e3, 1e8))
    force: tuple[float, ...] | None = key("N", default=None, sign="any")
    moment: tuple[float, ...] | None = key("N m", default=None, sign="any")
    displacement: dict[str, float] | None = key("m", default=None, sign="any")  # noqa: RUF009
    steps: int = key(default=1)


@dataclass(frozen=True, slots=True)
class Tie:
    """[ties.NAME]: two faces glued where they touch each other ([meshes.md](meshes.md)).

    Attributes:
        faces: two faces "part.face"; their meshes need not match.
        stiffness: stiffness of the layer between the faces; from the neighbouring materials if not
            given.
        search: largest distance at which the faces are glued; a twentieth of a facet's side if not
            given.
    """

    faces: tuple[str, ...]
    stiffness: float | None = key("Pa/m", default=None, band=(1e9, 1e17))
    search: float | None = key("m", default=None)


@dataclass(frozen=True, slots=True)
class Spring:
    """[springs]: springs from the face of this name to the ground, or between two faces.

    Springs to the ground are named "part.face" and are distributed evenly over the face. Springs
    between two faces have any name and connect the mean displacements of the faces
    ([meshes.md](meshes.md#springs-and-masses)). All act along axes 1 and 2 of the (first) face's
    part and along z.

    Attributes:
        faces: two faces connected by the springs, instead of a face and the ground.
        stiffness: total.
        stiffness_per_area: stiffness per area of an elastic foundation to the ground, in addition
            to the total.
        damping: total of dashpots parallel to the springs; they act in the complex modes.
    """

    faces: tuple[str, ...] | None = key(default=None)
    stiffness: tuple[float, ...] | None = key("N/m", default=None, sign="zero")
    stiffness_per_area: tuple[float, ...] | None = key("Pa/m", default=None, sign="zero")
    damping: tuple[float, ...] | None = key("N s/m", default=None, sign="zero")


@dataclass(frozen=True, slots=True)
class AddedMass:
    """[masses]: a mass spread evenly over a face, by its name "part.face".

    Attributes:
        mass: total.
        inertia: moments of inertia of the added body about the face's centroid, about axes 1 and 2
            of the part and about z, in addition to the inertia of the distributed mass.
    """

    mass: float = key("kg")
    inertia: tuple[float, ...] | None = key("kg m^2", default=None, sign="zero")


@dataclass(frozen=True, slots=True)
class Motion:
    """[motion]: rotation about an axis, or a direction.

    Attributes:
        axis: axis of the disc's rotation, "z" if neither it nor a direction is given; or its
            direction, as ``[0, 1, 1]``.
        point: a point of the axis [m]; the origin if not given.
        direction: direction in which the second body slides, in place of ``axis``.
        speed: angular speed about the axis, 1 rad/s if not given, or speed along the direction,
            1 m/s if not given.
    """

    axis: Literal["x", "y", "z"] | tuple[float, ...] | None = key(default=None, sign="any")
    point: tuple[float, ...] | None = key("m", default=None, sign="any")
    direction: tuple[float, ...] | None = key(default=None, sign="any")
    speed: str | None = key(default=None)

    @property
    def turns_about(self) -> tuple[float, ...]:
        """Direction of the axis of rotation."""
        if isinstance(self.axis, tuple):
            return self.axis
        return {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}.get(self.axis or "z", (0.0, 0.0, 1.0))

    @property
    def rate(self) -> float:
        """Speed along the direction [m/s], or about the axis [rad/s]."""
        if self.speed is None:
            return 1.0
        return to_si(self.speed, "rad/s" if self.direction is None else "m/s")


@dataclass(frozen=True, slots=True)
class EquilibriumTable:
    """[equilibrium]: solution of the braking equilibrium.

    Attributes:
        tolerance: residual of Newton's iterations relative to the contact forces, from 1e-13 to
            1e-3.
    """

    tolerance: float = key(default=1e-8)


@dataclass(frozen=True, slots=True)
class Stability:
    """[stability]: band and method of the eigenvalue analysis.

    Attributes:
        band: lowest and highest frequency.
        method: every sample at full order, or by one reduced model shared by all.
        cutoff: real modes of the bodies are kept up to here; 1.8 times the band if not given, more
            where materials change.
        tolerance: relative error of the eigenvalues for which the reduced model is built.
        on_tolerance: treatment of a sample with a mode whose estimated error is larger: it is
            counted in the log and in samples.csv ("warn"), or solved at full order ("full order").
        zeta_max: full order omits modes that decay with a larger damping ratio; below 0.7.
        verify: samples of the reduced model that are solved at full order as well.
        threshold: an unstable mode counts as squeal where its damping -2 alpha / |omega| lies below
            minus this; 0: every unstable mode.
        drivers: whether derivatives of the unstable modes with respect to friction, loads, contact
            and layers are computed ([stability.md](stability.md#what-drives-a-mode)).
        damping: terms of the damping; without the section there is no damping.
    """

    band: tuple[float, ...] = key("Hz", sign="zero", band=(0.0, 1e5))
    method: str = key(default="full", choices=("full", "reduced"))
    cutoff: float | None = key("Hz", default=None)
    tolerance: float = key(default=1e-5)
    on_tolerance: str = key(default="warn", choices=("warn", "full order"))
    zeta_max: float = key(default=0.1)
    verify: int = key(default=0, sign="zero")
    threshold: float = key(default=0.0, sign="zero")
    drivers: bool = False
    damping: Damping | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene.

    Attributes:
        stages: stages to run, in order.
        file: the TOML file.
        table: its content with the overrides of the command line.
    """

    stages: tuple[str, ...] = key(default=(), choices=STAGES)
    surface: Surface | None = None
    micro: Micro | None = None
    mesh: MeshTable = field(default_factory=MeshTable)
    parts: dict[str, Part] = field(default_factory=dict, metadata={"type": parts_type})
    materials: dict[str, MaterialTable] = field(default_factory=dict)
    contact: dict[str, Contact] = field(default_factory=dict)
    ties: dict[str, Tie] = field(default_factory=dict)
    supports: dict[str, tuple[str, ...]] = field(
        default_factory=dict, metadata={"type": _supports_type}
    )
    springs: dict[str, Spring] = field(default_factory=dict)
    masses: dict[str, AddedMass] = field(default_factory=dict)
    loads: dict[str, Load] = field(default_factory=dict)
    motion: Motion | None = None
    equilibrium: EquilibriumTable = field(default_factory=EquilibriumTable)
    stability: Stability | None = None
    samples: Samples = field(default_factory=Samples)
    sweep: Sweep | None = None
    countermeasures: tuple[Countermeasure, ...] = ()
    file: Path = key(default=Path(), internal=True)  # noqa: RUF009
    table: dict[str, Any] = field(default_factory=dict, metadata={"internal": True})

    @property
    def varied(self) -> list[str]:
        """Dotted keys of the scalars that are random or swept."""
        return sorted({*self.samples.random, *(self.sweep.parameters if self.sweep else ())})

    def path(self, name: str) -> Path:
        """A file named in the scene, relative to the scene's folder."""
        return self.file.parent / os.path.expanduser(name)

    def spoken(self, approach: str) -> str:
        """Name of an approach to a person: "multi-scale" is said of rough contact alone."""
        rough = any(c.law == "library" or c.gap != "none" for c in self.contact.values())
        return approach if rough or approach != "multi-scale" else "smooth contact"
