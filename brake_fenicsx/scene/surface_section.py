"""[surface] and [micro] of a scene: scans or statistics, and the laws that are made from them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from .keys import between, key
from .units import MODULI

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
