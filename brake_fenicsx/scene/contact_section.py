"""[surface], [micro] and [contact] of a scene: scans, their laws, interfaces between two faces."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Literal

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import reading

from .keys import between, key, rising_pair, shown
from .units import MODULI, factor_to_si, usual_unit, with_unit

LAWS = '"library", { linear = "2e13 Pa/m" }, { p0 = .., u0 = .. } or { table = .., units = .. }'
FRICTION = (0.0, 1.5)  # usual coefficients
MIN_ROWS = 4  # pressures at fewer gaps tell no stiffness between them

MAX_PIXELS = 2048  # along a side of a patch


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
        spectrum: spectrum of the artificial surfaces: that of the scan, the same in all directions;
            that of the scan with its direction; or its bi-fractal fit.
        grooves: direction of the grooves on the friction face, from its x axis, for spectrum
            "directional"; as in the scan if not given.
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
    spectrum: str = key(default="measured", choices=("fit", "measured", "directional"))
    grooves: float | None = key("rad", default=None, sign="any")
    low: str = key(default="flat", choices=("flat", "extend"))
    S_q: str = key(default="spectrum", choices=("spectrum", "scan"))
    distribution: str | None = key(default=None, choices=("measured", "johnson", "normal"))

    @property
    def scans(self) -> tuple[str, ...]:
        """Files of the scans; none where there are statistics in their place."""
        return (self.scan,) if isinstance(self.scan, str) else self.scan or ()

    def contradictions(self) -> Iterator[str]:
        """Scans or statistics, and what belongs to either."""
        if self.S_q == "scan" and self.form:
            yield """.S_q = "scan": the variance is that of the scan, and surface.form adds longer
                waves; leave one out"""
        if self.grooves is not None and self.spectrum != "directional":
            yield f""".grooves: spectrum = "{self.spectrum}" has no direction; write
                surface.spectrum = "directional", or leave it out"""
        if self.statistics and self.spectrum == "directional":
            yield '.spectrum = "directional": statistics have no direction; name a scan'
        for name in ("cutoff", "size", "height_unit") if self.statistics and not self.scan else ():
            if getattr(self, name) is not None:
                yield f".{name}: there is no scan, but statistics; leave it out"


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
            than a tenth of the hardness. Laws with a hardness are made to a few times the mean
            pressure of the brake's contact, and longer where a sample needs them, unless this is
            given.
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
    pixels: int | Literal["scan"] = key(
        default="scan",
        rule=(lambda n: n == "scan" or 2 <= n <= MAX_PIXELS, f"write 2 to {MAX_PIXELS}"),
    )
    boundary: str = key(default="free", choices=("free", "periodic"))
    laws: int = key(default=100, most=10**5)
    E: float = key("Pa", default=1983.3e6, band=MODULI)
    nu: float = key(
        default=0.4054,
        sign="any",
        rule=(lambda nu: abs(nu) < 1, "must lie between -1 and 1, E* = E / (1 - nu^2)"),
    )
    tolerance: float = key(default=1e-6, rule=between(1e-13, 0.01))
    max_pressure: float | None = key(default=None)
    steps: int = key(default=40)
    bulk_compliance: str = key(default="remove", choices=("remove", "keep"))
    seed: int = key(default=1, sign="zero", most=2**63 - 1)
    scans: int = key(default=20, sign="zero", most=10**5)
    hardness: float | None = key("Pa", default=None, band=(1e6, 2e10))

    def contradictions(self) -> Iterator[str]:
        """Laws that begin below their highest pressure, and end below the hardness."""
        if self.hardness is None:
            return
        E_star = self.E / (1.0 - self.nu**2)
        highest = (self.max_pressure or 0.0) * E_star
        # The ends of a law of ``micro.law_of_surface``.
        first, last = 1e-6 * E_star, 0.1 * self.hardness
        if highest >= self.hardness:
            yield f""".max_pressure = {self.max_pressure:g} E*, {highest / 1e6:.4g} MPa: must lie
                below micro.hardness = {self.hardness / 1e6:.4g} MPa; leave it out"""
        if self.max_pressure is None and last <= first:
            yield f""".hardness = {self.hardness:g} Pa: laws end at a tenth of it, {last:.3g} Pa,
                and begin at 1e-6 E*, {first:.3g} Pa; correct the unit, the hardness of linings is
                "50 MPa" to "400 MPa" """


@dataclass(frozen=True, slots=True)
class LawTable:
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

    def contradictions(self) -> Iterator[str]:
        """One of the three ways to write a law."""
        formula = {self.linear, self.p0, self.u0} != {None}
        if self.table is not None and formula:
            yield ": table replaces linear, p0 and u0; leave these out"
        elif self.table is not None and len(self.units) != 2:
            yield f'.units = {shown(self.units)}: write those of both columns, ["um", "MPa"]'
        elif self.table is None and self.linear is None and None in (self.p0, self.u0):
            yield f": write {LAWS}"
        elif self.linear is not None and {self.p0, self.u0} != {None}:
            yield ": write linear, or p0 and u0; not both"


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

    def contradictions(self) -> Iterator[str]:
        """Ranges of two rising values, and of no more than a turn."""
        ranges = {f: ends for f in fields(self) if (ends := getattr(self, f.name)) is not None}
        if not ranges:
            yield ": no range; write some of radius, angle, x, y, z, or leave it out"
        for f, ends in ranges.items():
            unit = usual_unit(f.metadata["unit"])
            at = f".{f.name} = {shown(with_unit(ends, f.metadata['unit']))}"
            if not rising_pair(ends):
                yield f'{at}: write [lowest, highest], such as ["10 {unit}", "20 {unit}"]'
            if f.name == "angle" and ends[1] - ends[0] > 2 * math.pi * (1 + 1e-12):
                yield f"{at}: more than a whole turn; leave it out for all angles"


@dataclass(frozen=True, slots=True)
class ContactTable:
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
        surface: surface of this interface alone, with the keys of [surface], which is that of all
            others; its laws are made with [micro].
        slip: "motion": the faces slide along the scene's motion; "stuck": they do not slide
            ([contact.md](contact.md#faces-that-stick)).
        tangential_stiffness: tangential stiffness of faces that stick, equal in all tangential
            directions; required with ``slip = "stuck"``.
    """

    faces: tuple[str, ...] = key(rule=(lambda f: len(f) == 2, "write two faces, the pad's first"))
    law: Literal["library"] | LawTable = key(default="library", write=LAWS)
    discretisation: str = key(default="patch", choices=("patch", "quadrature", "node"))
    gap: str = key(default="none", choices=("none", "hdf", "waviness"))
    friction: float | Friction = key(default=0.0, sign="zero", band=FRICTION)
    friction_in_equilibrium: bool = True
    search: float | None = key("m", default=None)
    zone: Zone | None = None
    surface: Surface | None = None
    slip: str = key(default="motion", choices=("motion", "stuck"))
    tangential_stiffness: float | None = key("Pa/m", default=None, band=(1e9, 1e17))

    def contradictions(self) -> Iterator[str]:
        """Faces slide or stick."""
        k_t = self.tangential_stiffness
        if self.slip == "stuck" and k_t is None:
            yield """.slip = "stuck": needs tangential_stiffness, that of the faces along each
                other, such as tangential_stiffness = "1e13 Pa/m" """
        if self.surface is not None and self.law != "library" and self.gap == "none":
            yield """.surface: nothing is made of it; write law = "library", or a gap"""
        if self.slip == "motion" and k_t is not None:
            yield f""".tangential_stiffness = {k_t:g} Pa/m: acts where faces stick; write slip =
                "stuck" as well, or leave it out"""


def with_table(contact: ContactTable, name: str, folder: Path) -> ContactTable:
    """An interface whose law has the steps of its table, where it names one.

    Args:
        contact: the interface as the scene writes it.
        name: its name.
        folder: the scene's folder, where tables are looked for.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    law, where = contact.law, f"contact.{name}.law"
    if not isinstance(law, LawTable) or law.table is None:
        return contact
    columns = zip(law.units, ("m", "Pa"), strict=True)
    factors = [factor_to_si(name, unit, f"{where}.units") for name, unit in columns]
    at = f"{where}.table = {law.table!r}"
    d, p = _columns(folder / law.table, at) * np.array(factors)[:, None]
    order = np.argsort(-d, kind="stable")
    d, p = d[order], p[order]
    if d.size < MIN_ROWS:
        raise SceneError(f"{at}: {d.size} rows; a law needs {MIN_ROWS} or more")
    if p[0] <= 0.0:
        raise SceneError(f"""{at}: {p[0]:g} Pa at the gap {d[0]:g} m; leave out rows without
            pressure: the law falls to zero beyond the widest gap by itself""")
    for i in np.flatnonzero((np.diff(d) >= 0.0) | (np.diff(p) <= 0.0)):
        raise SceneError(f"""{at}: {p[i + 1]:g} Pa at the gap {d[i + 1]:g} m and {p[i]:g} Pa at
            {d[i]:g} m; the pressure must rise as the gap falls: smooth the measured values""")
    return replace(contact, law=replace(law, steps=(tuple(d.tolist()), tuple(p.tolist()))))


def _columns(path: Path, at: str) -> np.ndarray:
    """Two columns of numbers, shape (2, rows); one heading and lines that begin with # are not."""
    with reading(path, "as text", at=f"{at}: "):
        text = path.read_text(encoding="utf-8-sig")
    rows: list[list[float]] = []
    heading = False
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.replace(",", " ").split()
        if not cells or cells[0].startswith("#"):
            continue
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if len(values) == 2 and np.isfinite(values).all():
            rows.append(values)
        elif values or rows or heading:
            raise SceneError(f"""{at}: line {number}: {line.strip()!r} does not contain two numbers;
                write a gap and a pressure with decimal points, separated by a blank or a comma""")
        else:
            heading = True
    return np.array(rows, float).reshape(-1, 2).T
