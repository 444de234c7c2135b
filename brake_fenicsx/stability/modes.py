"""Complex modes as records: band, damping, error, verdict, the parts that move, flutter partners.

lambda = alpha + i omega [1/s]; frequency |omega| / 2 pi; damping = -2 alpha / |omega|, negative
means unstable. An undamped problem K phi = kappa M phi has lambda^2 = -kappa: a complex pair of
kappa gives two rows, +-alpha. The rows of a band are chosen among eigenvalues here, rigid modes and
divergence included.

The share of a part in the kinetic energy of a mode phi is phi^H M_p phi / sum_q phi^H M_q phi, with
the mass M_p of the part on the dofs of all parts. Shared nodes belong to each part by its own mass,
so that nothing is counted twice. Strain energy is shared likewise, with stiffnesses.

Without damping the two modes of a flutter pair are lambda and -conj(lambda), with vectors phi and
conj(phi). Damping moves the two eigenvalues apart and turns the vectors a little: there the partner
is the mode whose shape is nearest to conj(phi), and it is a matter of degree.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import Array, Complex, Index, Mask
from brake_fenicsx.display import Shown, html_table, mesh_grid
from brake_fenicsx.errors import SceneError
from brake_fenicsx.mac import mac

from .eigensolvers.eigenpairs import times

# alpha beyond this share of |lambda| is called unstable; below it the model decides nothing.
THRESHOLD = 1e-6
# Modes below this share of the largest |lambda| are rigid.
RIGID_BELOW = 1e-3
# Eigenvalues up to this share of the band's end may be rigid modes; vectors of rigid modes that
# differ by less are one.
NEAR_ZERO, SAME_SHAPE = 1e-4, 1e-4


CountKind = Literal["proven", "counted", "not counted"]

# Two rows +-alpha of one pair agree to this share of |lambda|.
SAME = 1e-6

# Least MAC of the partner's shape with the conjugate one, by which at most one of two orthogonal
# shapes is the partner, and largest distance of the two frequencies relative to |lambda|: damping
# moves a pair apart by its damping ratios, 0.1 at most by default.
ALIKE, NEAR = 0.5, 0.1


@dataclass(frozen=True, slots=True)
class Count:
    """What is known of the number of modes.

    Attributes:
        kind: "proven": the number found is that of a count whose own condition holds; "counted":
            it is that of a count whose condition does not hold; "not counted".
        how: by what they were counted, or why not, and the modes beyond the damping ratios counted;
            nothing is decided by these words.
        expected: modes of the band, after what was found agreed with what was counted.
    """

    kind: CountKind
    how: str
    expected: int = 0


@dataclass(frozen=True, slots=True, repr=False)
class Modes(Shown):
    """Complex modes of a band, sorted by frequency, one of each conjugate pair.

    Attributes:
        s: eigenvalues lambda [1/s], shape (modes,).
        right: right vectors, shape (dofs or coordinates, modes); may have no column.
        left: left vectors, psi^H (lambda^2 M + lambda C + K) = 0; may have no column.
        residual: |(lambda^2 M + lambda C + K) phi| / |lambda^2 M phi| of each mode [-]; of the
            reduced model, which does not form it, 2 error / (condition |lambda|).
        error: estimated error of lambda [1/s].
        condition: eigenvalue condition number [-].
        count: expected number of modes.
        seconds: time [s].
        real: whether symmetry keeps the mode on the imaginary axis (a simple real kappa).
        on_mesh: gives the space of the displacements and those of a mode, shape (all dofs,); None
            of matrices alone.
    """

    s: Complex
    right: Complex
    left: Complex
    residual: Array
    error: Array
    condition: Array
    count: Count
    seconds: float
    real: Mask
    on_mesh: Callable[[int], tuple[Any, Complex]] | None = None

    def __post_init__(self) -> None:
        """An estimate that is no number is none: the error may have any size."""
        object.__setattr__(self, "error", np.where(np.isnan(self.error), np.inf, self.error))

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process gets: all but the mesh, which stays with its model."""
        names = (f.name for f in fields(self))
        return type(self), tuple(None if n == "on_mesh" else getattr(self, n) for n in names)

    def __len__(self) -> int:
        """Number of modes."""
        return int(self.s.size)

    def __repr__(self) -> str:
        """One line."""
        if not len(self):
            return "Modes(none)"
        ends = self.frequency.min(), self.frequency.max()
        unstable = self.verdict.count("unstable")
        return f"Modes({len(self)} from {ends[0]:.1f} to {ends[1]:.1f} Hz, {unstable} unstable)"

    def _repr_html_(self) -> str:
        """Modes as a table of a notebook."""
        columns: Any = self.frequency, self.s.real, self.damping, self.verdict
        heads = ("mode", "frequency [Hz]", "alpha [1/s]", "damping [-]", "verdict")
        rows = [[i, *cells] for i, cells in enumerate(zip(*columns, strict=True))]
        return html_table(repr(self), heads, rows)

    def _columns(self) -> dict[str, Any]:
        """One row for each mode, the columns named as in modes.csv."""
        return {
            "frequency_hz": self.frequency, "real_1_s": self.s.real, "damping": self.damping,
            "residual": self.residual, "error_estimate": self.error, "condition": self.condition,
            "verdict": self.verdict,
        }  # fmt: skip

    def _draw(self, *axes: Any) -> None:
        """Damping over frequency; unstable modes are coloured."""
        unstable, khz = np.array(self.verdict) == "unstable", 1e-3 * self.frequency
        axes[0].plot(khz[~unstable], self.damping[~unstable], "o", color="0.6", ms=4)
        axes[0].plot(khz[unstable], self.damping[unstable], "D", color="C3", label="unstable")
        axes[0].axhline(0.0, color="0.3", lw=0.6)
        axes[0].set(xlabel="frequency [kHz]", ylabel=r"damping $-2\,\alpha/|\omega|$ [-]")
        if unstable.any():
            axes[0].legend()

    def to_pyvista(self, mode: int) -> Any:
        """Shape of a mode on the mesh.

        Args:
            mode: its row.

        Returns:
            A grid of pyvista with the point data "re" and "im", the largest displacement 1; at the
            phase ``theta`` its points move by a share of ``re cos(theta) - im sin(theta)``.

        Raises:
            SceneError: no such mode, or modes of matrices alone.
        """
        if self.on_mesh is None:
            raise SceneError("to_pyvista: modes of matrices have no mesh; take those of a model")
        if mode not in range(len(self)):
            raise SceneError(f"to_pyvista: mode {mode!r}: there are 0 to {len(self) - 1}")
        return mesh_grid(*self.on_mesh(int(mode)))

    @property
    def frequency(self) -> Array:
        """|omega| / 2 pi [Hz]."""
        return np.asarray(np.abs(self.s.imag) / (2 * np.pi))

    @property
    def damping(self) -> Array:
        """-2 alpha / |omega| [-]; -inf for divergence, nan for rigid modes."""
        omega, alpha = np.abs(self.s.imag), self.s.real
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(omega > 0, -2 * alpha / omega, -alpha / 0.0) + 0.0)

    @property
    def verdict(self) -> list[str]:
        """Stable, unstable, or neutral where the error interval straddles the threshold."""
        limit = THRESHOLD * np.abs(self.s)
        error = np.where(self.real, 0.0, self.error)
        low, high = self.s.real - error, self.s.real + error
        return [
            "unstable" if a > l else "stable" if b < l else "neutral"
            for a, b, l in zip(low, high, limit, strict=True)
        ]


def relative_errors(s: Complex, error: Array) -> Array:
    """Estimated errors of eigenvalues over |lambda|, shape (modes,).

    Those of rigid modes, whose |lambda| is round-off, are nan: below 1e-3 of the largest. An error
    that is no number is infinite.
    """
    size = np.abs(s)
    elastic = size > RIGID_BELOW * size.max(initial=0.0)
    known = np.where(np.isnan(error), np.inf, error)
    return np.where(elastic, known / np.where(elastic, size, 1.0), np.nan)


def counted_rows(s: Complex, count: Count, zeta_max: float) -> Count:
    """Record of a count that agreed with the modes found in its region.

    Args:
        s: eigenvalues of the band [1/s], shape (modes,).
        count: how the region was counted.
        zeta_max: the region holds every mode of the band up to this damping ratio.
    """
    beyond = int(np.sum((s.imag != 0) & (np.abs(s.real) > zeta_max * np.abs(s))))
    note = f"; {beyond} beyond the damping ratio {zeta_max:g}, found but not counted"
    return replace(count, how=count.how + note * bool(beyond), expected=s.size)


def undamped_rows(
    kappa: Complex, error: Array, band: tuple[float, float]
) -> tuple[Index, Complex, Array, Mask]:
    """Rows of the band from the eigenvalues of K phi = kappa M phi, lambda^2 = -kappa.

    Args:
        kappa: eigenvalues [1/s^2], complex ones with their conjugates.
        error: their estimated errors [1/s^2].
        band: lowest and highest frequency [Hz].

    Returns:
        For each row: number of its kappa, lambda [1/s], error of lambda [1/s], and whether kappa
        is real, positive and too far from all others and from zero for an error to have made it so.
    """
    lam = np.sqrt(-kappa.astype(complex))
    # Of the two roots +-lambda the one with omega > 0; of two real ones the growing one.
    lam = np.where(lam.imag < 0, -lam, lam)
    with np.errstate(divide="ignore"):
        spread = np.where(np.abs(lam) > 0, error / (2 * np.abs(lam)), np.sqrt(error))
    frequency = lam.imag / (2 * np.pi)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & (lam.imag > 0)
    diverging = (lam.imag == 0) & (kappa.real < 0) & (band[0] <= 0)
    chosen = np.flatnonzero(inside | diverging)
    order = chosen[np.lexsort((lam[chosen].real, frequency[chosen]))]
    return order, lam[order], spread[order], _surely_real(kappa, error)[order]


def _surely_real(kappa: Complex, error: Array) -> Mask:
    """Surely real and positive kappa: its error disc meets no other disc and not zero."""
    real = (kappa.imag == 0) & (kappa.real > error)
    order = np.argsort(kappa.real, kind="stable")
    x, e = kappa.real[order], 2 * error[order]
    clear = np.ones(kappa.size, dtype=bool)
    if kappa.size > 1:
        touch = np.diff(x) <= e[1:] + e[:-1]
        clear[1:] &= ~touch
        clear[:-1] &= ~touch
    out = np.empty_like(clear)
    out[order] = clear
    return real & out


def damped_rows(
    s: Complex, right: Complex, error: Array, band: tuple[float, float], zeta_max: float
) -> tuple[Index, Complex]:
    """Rows of the band among some eigenvalues with omega >= 0, rigid modes first.

    Args:
        s: eigenvalues [1/s], shape (found,).
        right: their vectors, shape (size, found).
        error: their estimated errors [1/s].
        band: lowest and highest omega [rad/s].
        zeta_max: modes that decay faster are left out; those that grow faster are not.

    Returns:
        Number of each row's eigenvalue, and the eigenvalue, zero for a rigid mode.
    """
    low, high = band
    wanted = (s.imag > 0) & (s.imag >= low) & (s.imag <= high) & (s.real >= -zeta_max * np.abs(s))
    wanted |= (s.imag == 0) & (s.real > 0) & (low <= 0)
    rigid = (np.abs(s) <= np.minimum(error, NEAR_ZERO * high)) & (low <= 0)
    rows = np.r_[_independent(right, np.flatnonzero(rigid)), np.flatnonzero(wanted & ~rigid)]
    # What cannot be told from zero is a rigid mode: no frequency, no verdict.
    return rows, np.where(np.abs(s[rows]) <= error[rows], 0.0, s[rows])


def _independent(right: Complex, among: Index) -> Index:
    """Those of some eigenvalues at zero that have vectors of their own.

    A rigid mode that nothing damps is a double zero, and round-off splits zeros into pairs of any
    kind: their vectors tell how many modes there are.
    """
    if not among.size:
        return among
    X = right[:, among] / np.linalg.norm(right[:, among], axis=0)
    _, R, order = la.qr(np.hstack([X.real, X.imag]), mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > SAME_SHAPE * abs(R[0, 0])))
    # A vector may stand in twice, by its real and its imaginary part.
    first = list(dict.fromkeys(int(i) % among.size for i in order))[:rank]
    return among[np.sort(first)]


def energy_shares(parts: Mapping[str, Any], phi: Complex) -> dict[str, Array]:
    """Share of each part in the energy of each mode.

    Args:
        parts: name -> mass [kg] or stiffness [N/m] of the part on all dofs, symmetric and positive
            semi-definite, sparse or dense, shape (dofs, dofs).
        phi: displacements of the modes, shape (dofs, modes), or coordinates with matrices of these.

    Returns:
        For each part the shares [-], shape (modes,); they sum to one.

    Raises:
        SceneError: a mode has no energy in any part.
    """
    energy = {
        name: np.maximum(np.einsum("im,im->m", phi.conj(), times(A, phi)).real, 0.0)
        for name, A in parts.items()
    }
    total = np.sum(list(energy.values()), axis=0)
    if not np.all(total > 0):
        raise SceneError(f"participation: mode {int(np.argmin(total))} has no energy in any part")
    return {name: e / total for name, e in energy.items()}


def flutter_partners(s: Complex) -> Index:
    """The other row of each flutter pair of an undamped problem.

    Args:
        s: eigenvalues lambda [1/s], one of each conjugate pair, shape (modes,).

    Returns:
        For each mode the row with -conj(lambda), which coalesced with it; -1 for a mode on the
        imaginary axis, a divergence, or where that row is not in the list.
    """
    partner = np.full(s.size, -1)
    for i in np.flatnonzero((s.real != 0) & (s.imag != 0)):
        distance = np.abs(s + s[i].conj())
        # A mode closer to the axis than the tolerance would be its own partner.
        distance[i] = np.inf
        j = int(np.argmin(distance))
        if distance[j] <= SAME * abs(s[i]):
            partner[i] = j
    return partner


def damped_partners(s: Complex, phi: Complex, M: Any, unstable: Mask) -> Index:
    """The mode that each growing mode of a damped problem coalesced with, by its shape.

    Args:
        s: eigenvalues lambda [1/s], one of each conjugate pair, shape (modes,).
        phi: right vectors, shape (dofs, modes).
        M: mass [kg], SciPy sparse.
        unstable: which modes grow, shape (modes,).

    Returns:
        For each mode its partner's row; -1 for one that has none: it does not grow and no growing
        mode names it, or no other mode is alike (one that falling friction alone drives).
    """
    partner = np.full(s.size, -1)
    image = M @ phi
    for i in np.flatnonzero(unstable & (s.imag != 0)):
        near = np.abs(s.imag - s[i].imag) <= NEAR * abs(s[i])
        near[i] = False
        mirrored, its_image = phi[:, [i]].conj(), image[:, [i]].conj()
        likeness = np.where(near, mac(mirrored, phi, its_image, image)[0].real, 0.0)
        j = int(np.argmax(likeness))
        if likeness[j] >= ALIKE:
            partner[i] = j
            partner[j] = i if partner[j] < 0 else partner[j]
    return partner
