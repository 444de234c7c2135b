"""Variables of the reduced model, its contact rows and the forces along them.

Without contact a substructure is a matrix polynomial P(w) = P_0 + w P_1 + w^2 P_2 about a real
shift, in units in which the end of the band is 1:

    undamped    w = kappa + sigma,      P = [K + sigma M, -M],                  kappa = -lambda^2
    damped      w = lambda - lambda_0,  P = [K + lambda_0 C + sigma M, C + 2 lambda_0 M, M]

with sigma = lambda_0^2. Contact and friction of a sample are linearised at its equilibrium:
a motion with the gaps g, the slips v_T along and v_R across the sliding direction meets the forces

    w k g on the gaps,   mu w k g + lambda w p mu'(V) v_T along,   lambda (w mu p / V) v_R across

of each contact element, along the rows I = [N; T] or [N; T; R]; see ``damping`` for their signs.
They are J u of the gaps and slip rates u = [g; lambda v_T; lambda v_R].
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.errors import SceneError

# sigma in units of the band's end: positive, so that free bodies have a factor, and small.
SIGMA = 0.05


@dataclass(frozen=True, slots=True)
class Rows:
    """Blocks of contact rows: those whose motion forces follow, and those forces act along.

    Attributes:
        followed: "N", then "T" and "R" where forces follow the slip rates along and across.
        damped: whether a body depends on a rate: its variable w is lambda - lambda_0 then, else
            kappa + sigma.
    """

    followed: str
    damped: bool

    @property
    def acting(self) -> str:
        """Normal forces and friction act in any case."""
        return "NT" + "R" * ("R" in self.followed)

    @property
    def rates(self) -> bool:
        """Whether anything depends on a rate, so that eigenvalues are z = lambda - lambda_0."""
        return self.damped or self.followed != "N"

    @property
    def shift(self) -> float:
        """lambda_0; 0 where eigenvalues are z = kappa + sigma."""
        return float(np.sqrt(SIGMA)) if self.rates else 0.0

    def gaps(self, motions: int) -> int:
        """Gaps among a number of motions that forces follow; slips come after them."""
        return motions // len(self.followed)

    @property
    def _contact_rates_alone(self) -> bool:
        """Whether contact forces follow rates and bodies do not, so that w is not z."""
        return self.rates and not self.damped

    def variable(self, z: Complex) -> Complex:
        """The variable w of the bodies at eigenvalues z."""
        return SIGMA - (z + self.shift) ** 2 if self._contact_rates_alone else z

    def slope(self, z: Complex) -> Complex:
        """dw/dz."""
        return -2 * (z + self.shift) if self._contact_rates_alone else np.ones_like(z)

    def powers(self, count: int) -> Array:
        """Coefficients of z^m in w^n, n < count, shape (powers of z, count)."""
        w = [0.0, -2 * self.shift, -1.0] if self._contact_rates_alone else [0.0, 1.0]
        out = np.zeros(((count - 1) * (len(w) - 1) + 1, count))
        out[0, 0] = 1.0
        for n in range(1, count):
            out[:, n] = np.convolve(out[:, n - 1], w)[: len(out)]
        return out


def shifted_polynomial(K: Any, C: Any, M: Any, rows: Rows) -> list[Any]:
    """P_0, P_1 and, with rates, P_2 of a body from its matrices in units of the band's end.

    Args:
        K: stiffness, sparse or dense.
        C: damping; None where the body has none.
        M: mass.
        rows: whether anything depends on a rate.
    """
    if not rows.damped:
        return [K + SIGMA * M, -M]
    s, C = rows.shift, 0 * K if C is None else C
    return [K + s * C + SIGMA * M, C + 2 * s * M, M]


@dataclass(frozen=True, slots=True)
class ContactLinearisation:
    """What acts in the contact elements of one sample, each of shape (elements,).

    Attributes:
        k: contact stiffness [Pa/m], zero where the element is open.
        friction: tangential force per gap, mu k [Pa/m].
        along: p mu'(V) [Pa s/m]; zero without falling friction.
        across: mu p / V [Pa s/m]; zero without sliding damping.
    """

    k: Array
    friction: Array
    along: Array
    across: Array

    @classmethod
    def of(
        cls, k: ArrayLike, mu: ArrayLike, along: ArrayLike = 0.0, across: ArrayLike = 0.0
    ) -> "ContactLinearisation":
        """Check and complete the numbers of one sample.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            along: p mu'(V) [Pa s/m], likewise.
            across: mu p / V [Pa s/m], likewise.

        Raises:
            SceneError: a stiffness is negative, or a number is not finite or has the wrong shape.
        """
        k = np.asarray(k, dtype=float)
        named = {"k": k, "mu": mu, "along": along, "across": across}
        out = {}
        for name, value in named.items():
            given = np.asarray(value, dtype=float)
            if k.ndim != 1 or given.shape not in ((), k.shape):
                raise SceneError(f"""{name}: shape {given.shape}, one value for each contact element
                    is needed""")
            if not np.all(np.isfinite(given)):
                raise SceneError(f"{name}: a value is not finite")
            out[name] = np.broadcast_to(given, k.shape)
        if k.size and k.min() < 0:
            raise SceneError(f"k = {k.min():.3g} Pa/m: contact stiffness must not be negative")
        friction = out["mu"] * out["k"]
        return cls(out["k"], friction, out["along"], out["across"])

    @property
    def closed(self) -> Index:
        """Elements in which anything acts."""
        return np.flatnonzero(
            (self.k > 0) | (self.friction != 0) | (self.along != 0) | (self.across != 0)
        )

    def scaled(self, w: Array, elements: Index, omega: float) -> "ContactLinearisation":
        """Forces of some elements over their motions, in units of the band's end.

        Args:
            w: areas of all elements [m^2].
            elements: the chosen ones.
            omega: end of the band [rad/s].
        """
        force, rate = w[elements] / omega**2, w[elements] / omega
        k, friction = force * self.k[elements], force * self.friction[elements]
        along, across = rate * self.along[elements], rate * self.across[elements]
        return ContactLinearisation(k, friction, along, across)

    def part(self, some: Index) -> "ContactLinearisation":
        """Some of the elements."""
        every = self.k, self.friction, self.along, self.across
        return ContactLinearisation(*(x[some] for x in every))

    def after(self, A: AnyArray, rows: Rows) -> AnyArray:
        """A J, in the precision of A.

        Args:
            A: shape (rows, acting rows).
            rows: blocks of contact rows.

        Returns:
            Shape (rows, followed rows).
        """
        n = self.k.size
        out = np.empty((len(A), len(rows.followed) * n), A.dtype)
        blocks = [(0, self.k), *self._rates(rows)]
        for j, (place, factor) in enumerate(blocks):
            own = A[:, place * n : (place + 1) * n], factor.astype(A.dtype, copy=False)
            np.multiply(*own, out=out[:, j * n : (j + 1) * n])
        if self.friction.any():
            out[:, :n] += A[:, n : 2 * n] * self.friction.astype(A.dtype, copy=False)
        return out

    def forces(self, u: Complex, rows: Rows) -> Complex:
        """J u of gaps and slip rates, shape (acting rows, columns)."""
        n = self.k.size
        blocks = [self.k[:, None] * u[:n], self.friction[:, None] * u[:n]]
        blocks += [np.zeros_like(blocks[0])] * (len(rows.acting) - 2)
        for j, (place, rate) in enumerate(self._rates(rows), 1):
            blocks[place] = blocks[place] + rate[:, None] * u[j * n : (j + 1) * n]
        return np.vstack(blocks)

    def _rates(self, rows: Rows) -> list[tuple[int, Array]]:
        """For each followed row beside "N", its place among the acting rows and its factor."""
        factor = {"T": self.along, "R": self.across}
        return [(rows.acting.index(name), factor[name]) for name in rows.followed[1:]]
