"""[equilibrium], [stability] and its damping: how equilibrium and modes are computed.

Signs and derivations of the damping terms are in ``stability.damping_matrices``.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from .keys import below, between, key, rising_pair
from .units import to_si

# Least and largest tolerance of Newton's iterations [-].
NEWTON = (1e-13, 1e-3)
# Beyond about 1/sqrt(2) the squares of damped frequencies are no longer positive.
ZETA_LIMIT = 0.7
WHERE = "stability.damping"
TERMS = ("rayleigh", "loss", "sliding", "slope", "gyroscopic", "modal")
TERM_NAMES = f"{', '.join(TERMS[:-1])} or {TERMS[-1]}"


@dataclass(frozen=True, slots=True)
class EquilibriumTable:
    """[equilibrium]: solution of the braking equilibrium.

    Attributes:
        tolerance: residual of Newton's iterations relative to the contact forces, from 1e-13 to
            1e-3.
    """

    tolerance: float = key(default=1e-8, rule=between(*NEWTON))


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """[stability.damping.modal.PART]: damping ratio of the modes of a part.

    Attributes:
        ratio: damping ratio zeta, one number, or one for each frequency.
        frequency: rising frequencies of the ratios; linear between them, constant outside.
    """

    ratio: float | tuple[float, ...] = key(sign="zero", band=(0.0, 0.2))
    frequency: tuple[float, ...] = key("Hz", default=(), sign="zero")

    def contradictions(self) -> Iterator[str]:
        """Ratios below 1, and as many rising frequencies where there are several."""
        values = self.ratio if isinstance(self.ratio, tuple) else (self.ratio,)
        if not values or not all(value < 1 for value in values) or not any(values):
            yield f".ratio = {self.ratio}: write damping ratios below 1, some above 0"
        if len(self.frequency) != (len(values) if isinstance(self.ratio, tuple) else 0):
            yield f""": {len(self.frequency)} frequencies for {len(values)} ratios; write one ratio,
                or lists of as many of both"""
        if any(b <= a for a, b in pairwise(self.frequency)):
            yield ".frequency: the frequencies must rise"


@dataclass(frozen=True, slots=True)
class Damping:
    """[stability.damping]: terms of the damping.

    Attributes:
        rayleigh: alpha [1/s] of the mass and beta [s] of the elastic stiffness.
        loss: whether the loss factors of the materials act, ``materials.NAME.loss``.
        omega_ref: frequency at which the loss factors are exact, "2 kHz" or "12566 rad/s"; needed
            with loss.
        sliding: whether friction rotates with the direction of sliding.
        slope: whether friction changes with the speed of sliding.
        gyroscopic: whether the second bodies of the interfaces rotate; or the names of the rotating
            parts.
        modal: damping ratio of the modes of a part without contact; only for reduced models.
        own: terms of a user's own (``extensions.DampingTerm``).
    """

    rayleigh: tuple[float, ...] | None = key(default=None, units=("1/s", "s"), sign="zero")
    loss: bool = False
    omega_ref: str | None = key(default=None)
    sliding: bool = False
    slope: bool = False
    gyroscopic: bool | tuple[str, ...] = False
    modal: dict[str, ModalDamping] = field(default_factory=dict)
    own: tuple[Any, ...] = key(default=(), internal=True)

    @property
    def reference(self) -> float:
        """omega_ref [rad/s]."""
        return to_si(self.omega_ref, "rad/s")

    def contradictions(self) -> Iterator[str]:
        """Some term; loss factors and their frequency belong together."""
        written = f".omega_ref = {self.omega_ref!r}"
        if self.omega_ref is not None and not self.loss:
            yield f"{written}: has no meaning without loss = true"
        if self.omega_ref is None and self.loss:
            yield '.loss: needs omega_ref, where loss is exact, such as omega_ref = "2 kHz"'
        if self.omega_ref is not None:
            try:
                if not self.reference > 0:
                    yield f"{written}: must be positive"
            except ValueError:
                yield f'{written}: write a frequency, "2 kHz" or "12566 rad/s"'
        if not any(getattr(self, name) for name in TERMS):
            yield f": no term; name {TERM_NAMES}, or leave the section out"
        if self.rayleigh is not None and not any(self.rayleigh):
            yield ".rayleigh = [0, 0]: no damping; leave it out"


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

    band: tuple[float, ...] = key(
        "Hz", sign="zero", band=(0.0, 1e5), rule=(rising_pair, "write [lowest, highest]")
    )
    method: str = key(default="full", choices=("full", "reduced"))
    cutoff: float | None = key("Hz", default=None, band=(0.0, 1e6))
    tolerance: float = key(default=1e-5, rule=between(1e-12, 0.01))
    on_tolerance: str = key(default="warn", choices=("warn", "full order"))
    zeta_max: float = key(default=0.1, rule=between(1e-6, ZETA_LIMIT))
    verify: int = key(default=0, sign="zero")
    threshold: float = key(
        default=0.0,
        sign="zero",
        rule=below(1, "no mode has so large a damping; write a fraction, such as 0.01"),
    )
    drivers: bool = False
    damping: Damping | None = None

    def contradictions(self) -> Iterator[str]:
        """The modes that are kept reach beyond the band."""
        if self.method == "reduced" and self.cutoff is not None and self.cutoff <= self.band[1]:
            yield f""".cutoff = {self.cutoff:g} Hz: must lie above the band's {self.band[1]:g} Hz;
                raise it, or leave it out"""
