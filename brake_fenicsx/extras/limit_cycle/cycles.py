"""Limit cycles of a study's samples: each mode alone along its branch, and the sound it radiates.

``Cycles`` gives what the scene and a sample say to ``SampleCycles``, its equations. For the sound,
every node is a small piston with its share of the area; faces that look the same way radiate
together (Rayleigh's integral). Of velocities v of sources in a baffle at omega = k c,

    P = rho omega^2 / (4 pi c)  sum_ij A_i A_j Re(v_i v_j*) sin(k r_ij) / (k r_ij)

(Elliott and Johnson, J. Acoust. Soc. Am. 94, 1993, doi:10.1121/1.407490). A real disc has no
baffle, and air passes around its rim: an estimate, too loud at low frequencies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, Ints, Mask
from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.elasticity import FreeDofs
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.macro.faces import gather_face
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.sampling import friction_law
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scene import PERFECT
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures import ReducedModel

from .bodies import reduced_bodies
from .growth import (
    STABLE,
    UNDAMPED,
    UNDECIDED,
    Cycle,
    GrowthBranch,
    exponents,
    follow,
    time_to_reach,
    verdict,
)
from .harmonic_balance import HarmonicBalance, PeriodForces
from .keys import LimitCycle

if TYPE_CHECKING:
    from brake_fenicsx.model import Model
    from brake_fenicsx.samples.sampling import SampleInput

# Largest first motion of a closed patch, over its pressure by stiffness.
START = 0.3

# Loss factor of the bodies from the second harmonic on where nothing is damped: else a harmonic
# that meets a mode of the bodies turns the branch back and forth.
LOSS = 0.02

# Columns of what is measured of a cycle.
SOUND = ("sound_power_db", "level_1m_db")
MOTION = "amplitude_um", "gap_um", "frequency_hz", "disc_um", "disc_mm_s", "pad_um", "pad_mm_s"
SHARES = "open_share", "yield_share", "slip_over_speed", "time_s"
EXPONENTS = "harmonics_left_out", "exponent_1_s", "exponent_error_1_s", "exponent_hz"
MEASURES = *MOTION, *SHARES, *SOUND, *EXPONENTS

# Outcomes that may be what is heard. What takes the place of another one is not computed, and may
# be several times as large.
HEARD = (STABLE, UNDECIDED, UNDAMPED)

DENSITY, SPEED = 1.204, 343.2  # of air at 20 C [kg/m^3], [m/s]
REFERENCE = 1e-12  # sound power of 0 dB [W]
# From sound power to the level at 1 m in the open, 20 uPa: a sphere of 4 pi m^2.
AT_ONE_METRE = -11.0
# Harmonics whose velocity is less than this share of the largest are left out.
QUIET = 1e-3


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes of some faces.

    Attributes:
        columns: free number of each displacement, -1 where held, shape (nodes, 3).
        place: positions [m], shape (nodes, 3).
        area: outward area of each node [m^2], shape (nodes, 3).
    """

    columns: Ints
    place: Array
    area: Array

    def displacement(self, u: Complex) -> Complex:
        """Of vectors on the free dofs, shape (dofs, n) to (nodes, 3, n)."""
        return np.where((self.columns >= 0)[..., None], u[self.columns], 0.0)

    def power(self, velocity: Complex, omega: float) -> float:
        """Sound power [W] of one frequency.

        Args:
            velocity: amplitudes [m/s], shape (nodes, 3).
            omega: angular frequency [rad/s].
        """
        flow, total = np.einsum("nc,nc->n", velocity, self.area), 0.0
        left = np.ones(flow.size, bool)
        while left.any():
            side = left & (self.area @ self.area[np.argmax(left)] > 0)
            side[np.argmax(left)] = True
            left &= ~side
            x, v = self.place[side], flow[side]
            apart = np.linalg.norm(x[:, None] - x[None], axis=2)
            kernel = np.sinc(omega / SPEED / np.pi * apart)
            total += float((v.conj() @ kernel @ v).real)
        return DENSITY * omega**2 / (4 * np.pi * SPEED) * total


def nodes_of(mesh: Mesh, free: FreeDofs, faces: Sequence[str]) -> Nodes:
    """The nodes of some faces, each once.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        faces: their names, "part.face".
    """
    columns, place, area, number = [], [], [], []
    for face in map(lambda name: gather_face(mesh, free, name), faces):
        corner = face.corners
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, -1] - corner[:, 0])
        if face.element.corners == 4:
            across = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
        size = 0.5 * np.linalg.norm(across, axis=1)
        share = size[:, None] * face.element.tributary
        area.append((share[..., None] * face.normal[:, None]).reshape(-1, 3))
        columns.append(face.columns.reshape(-1, 3))
        place.append(face.nodes.reshape(-1, 3))
        number.append(face.number.ravel())
    _, first, each = np.unique(np.concatenate(number), return_index=True, return_inverse=True)
    total = np.zeros((first.size, 3))
    np.add.at(total, each, np.concatenate(area))
    return Nodes(np.concatenate(columns)[first], np.concatenate(place)[first], total)


def sound_power(nodes: Nodes, u: Complex, omega: float) -> float:
    """Sound power of a periodic vibration [W].

    Args:
        nodes: of the faces that radiate.
        u: displacements on the free dofs of the mean and each harmonic [m], shape (dofs, n + 1).
        omega: angular frequency of the first [rad/s].
    """
    velocity = nodes.displacement(u) * (1j * omega * np.arange(u.shape[1]))
    size = np.abs(velocity).max(axis=(0, 1), initial=0.0)
    loud = np.flatnonzero(size > QUIET * size.max())
    return sum(nodes.power(velocity[..., n], n * omega) for n in loud)


def decibels(power: float) -> float:
    """Level of a sound power, re 1 pW [dB]; nan of silence."""
    return float(10 * np.log10(power / REFERENCE)) if power > 0 else float("nan")


@dataclass(frozen=True, slots=True)
class SampleCycles:
    """The limit cycles of a sample.

    Attributes:
        model: the reduced model.
        p: the sample's point of its box.
        forces: of all contact elements.
        closed: whether each is closed at equilibrium, and carries.
        damped: whether anything is damped.
        faces: nodes whose motion is measured: of the disc, which radiate, and of the pads.
        slip: slip of the elements along the sliding direction, shape (elements, dofs).
    """

    model: ReducedModel
    p: Array
    forces: PeriodForces
    closed: Mask
    damped: bool
    faces: tuple[Nodes, Nodes]
    slip: sp.csr_matrix

    def branch(
        self, problem: HarmonicBalance, s: complex, a: AnyArray, largest: float
    ) -> GrowthBranch:
        """Growth of a mode over its amplitude.

        Args:
            problem: harmonic balance of the sample.
            s: its eigenvalue [1/s].
            a: its coordinates, shape (kept modes,).
            largest: amplitude at which to end [m].

        Raises:
            NotConverged: no vibration of small amplitude is found.
        """
        y = problem.at_rest(s, a)
        p, k, _ = (x[self.closed, 0] for x in self.forces.pressure(self.forces.g[:, None]))
        share = p / k / np.abs(y[: self.closed.size][self.closed])
        start = problem.start(s, a, y, START * float(share.min()) * problem.size(y))
        return follow(problem, start, largest, self.damped)

    def problem(self, harmonics: int, points: int) -> HarmonicBalance:
        """Harmonic balance of the sample.

        Args:
            harmonics: beside the mean.
            points: of time over a period.
        """
        weights = np.zeros(len(self.forces.followed) * self.closed.size)
        own = self.forces.w * self.closed
        weights[: own.size] = own / own.sum()
        bodies = reduced_bodies(self.model, self.p, self.forces.friction.mu)
        loss = 0.0 if self.damped else LOSS
        return HarmonicBalance(bodies, self.forces, weights, harmonics, points, loss)

    def measured(
        self, problem: HarmonicBalance, cycle: Cycle, branch: GrowthBranch
    ) -> dict[str, float]:
        """``MEASURES`` of a cycle."""
        forces, at, omega = self.forces, cycle.at, cycle.at.s.imag
        gap = problem.over_time(at.y[: self.closed.size])
        touch = forces.laws.first_touch()
        opens = (forces.g + gap.max(axis=1) > touch) & self.closed
        yields = forces.yields & (gap.min(axis=1) < 0) & (forces.g + gap.min(axis=1) < touch)
        u = self.model.kept_displacements(at.a)
        numbers = []
        for nodes in self.faces:
            moved = nodes.displacement(u)
            for x in (1e6 * moved * [0.0, *np.ones(at.y.shape[1] - 1)], 1e3 * moved * at.lam):
                each = problem.over_time(x.reshape(-1, x.shape[2])).reshape(*x.shape[:2], -1)
                # A body without a kept mode moves by its local compliance alone: no number.
                numbers.append(float(np.linalg.norm(each, axis=1).max(initial=0.0)) or np.nan)
        rate = np.abs(problem.over_time(self.slip @ (u * at.lam))).max(axis=1)
        moving = (forces.friction.speed > 0) & self.closed
        ratio = (rate[moving] / forces.friction.speed[moving]).max(initial=0.0)
        level = decibels(sound_power(self.faces[0], u, omega))
        last = np.linalg.norm(at.y[:, -1]) / np.linalg.norm(at.y[:, 1])
        mu = exponents(problem, at) if cycle.kind == STABLE else np.full(2, np.nan + 0j)
        largest = mu[1 + np.argmax(mu[1:].real)]
        sizes = 1e6 * at.amplitude, 0.5e6 * float(np.ptp(gap, axis=1).max()), omega / (2 * np.pi)
        shares = (float(x.sum() / self.closed.sum()) for x in (opens, yields))
        slow = float(ratio), time_to_reach(branch, cycle), level, level + AT_ONE_METRE
        rest = float(last), largest.real, abs(mu[0].real), largest.imag / (2 * np.pi)
        values = *sizes, *numbers, *shares, *slow, *rest
        return dict(zip(MEASURES, values, strict=True))

    def arrays(self, modes: Modes, settings: LimitCycle, threshold: float) -> dict[str, Any]:
        """Limit cycles of the growing modes, each alone, as arrays to store.

        Args:
            modes: by the reduced model.
            settings: the section of the scene.
            threshold: modes grow whose damping lies below minus this.

        Returns:
            ``cycle_mode``, ``cycle_kind``, ``cycle_values``, shape (cycles, measures), the names of
            these, ``cycle_names``; of the branches ``branch_mode``, ``branch_amplitude`` [m] and
            ``branch_s`` [1/s], point by point.
            A mode whose growth does not end has a row of the kind "none" with what ended it.
        """
        problem: HarmonicBalance | None = None
        rows: list[tuple[int, str, dict[str, float]]] = []
        points: list[tuple[int, float, complex]] = []
        nothing = dict.fromkeys(MEASURES, float("nan"))
        grows = (np.array(modes.verdict, str) == "unstable") & (modes.damping < -threshold)
        # damping_below = 0: only the modes that grow beyond the threshold.
        more = modes.damping < (settings.damping_below or -np.inf)
        for i in map(int, np.flatnonzero((modes.s.imag > 0) & (grows | more))):
            problem = problem or self.problem(settings.harmonics, settings.points)
            try:
                branch = self.branch(problem, modes.s[i], modes.right[:, i], settings.largest)
            except NotConverged as error:
                logger.warning("mode %d: %s", i, error)
                rows.append((i, "none: failed", nothing))
                continue
            points += [(i, *point) for point in zip(branch.amplitude, branch.s, strict=True)]
            for cycle in branch.cycles:
                values, outcome = self.measured(problem, cycle, branch), cycle.kind
                if outcome == STABLE:
                    growth, accuracy = values["exponent_1_s"], values["exponent_error_1_s"]
                    ratio = values["exponent_hz"] / values["frequency_hz"]
                    outcome = verdict(growth, accuracy, ratio)
                if not outcome.startswith(HEARD):
                    values |= dict.fromkeys(SOUND, float("nan"))
                rows.append((i, outcome, values))
            if grows[i] and not any(cycle.kind in (STABLE, UNDAMPED) for cycle in branch.cycles):
                rows.append((i, f"none: {branch.end}", nothing))
        number, amplitude, s = np.array(points, complex).reshape(-1, 3).T
        numbers = np.array([[*row[2].values()] for row in rows]).reshape(-1, len(MEASURES))
        return {
            "cycle_mode": np.array([row[0] for row in rows], dtype=np.intp),
            "cycle_kind": np.array([row[1] for row in rows], dtype=str),
            "cycle_values": numbers, "cycle_names": np.array(MEASURES),
            "branch_mode": number.real.astype(np.intp), "branch_amplitude": amplitude.real,
            "branch_s": s,
        }  # fmt: skip


class Cycles:
    """Limit cycles of any sample of a scene."""

    def __init__(self, scene: Scene, models: Models):
        """Gather the faces whose motion is measured."""
        brake, self._table = models.brake, scene.section("limit_cycle")
        pairs = [contact.faces for contact in scene.contact.values()]
        disc = self._table.radiating or tuple(dict.fromkeys(faces[1] for faces in pairs))
        pads = tuple(dict.fromkeys(faces[0] for faces in pairs))
        nodes = partial(nodes_of, brake.mesh, brake.elastic.free)
        self._scene, self._models, self._faces = scene, models, (nodes(disc), nodes(pads))
        self._threshold = models.stability.threshold if models.stability else 0.0

    def of(
        self, sample: SampleInput, eq: Equilibrium, modes: Modes, partner: Index, reduced: bool
    ) -> dict[str, Any]:
        """Limit cycles of a sample's growing modes; see ``SampleCycles.arrays``.

        Args:
            sample: its inputs.
            eq: its equilibrium.
            modes: its modes.
            partner: flutter partner of each; not used.
            reduced: whether they are those of the reduced model.

        Raises:
            InaccurateResult: they are not.
        """
        if not reduced:
            raise InaccurateResult("a sample at full order has none: they are of the reduced model")
        return self.sample(sample, eq).arrays(modes, self._table, self._threshold)

    def sample(self, sample: SampleInput, eq: Equilibrium) -> SampleCycles:
        """The equations of a sample; arguments as above."""
        reduction, scene, approach = self._models.reduction, self._scene, sample.approach
        model, contact = reduction.of(sample.approach), sample.brake.contact
        hard = scene.micro is not None and scene.micro.hardness is not None
        hard = hard and approach not in PERFECT
        yields = np.array([hard and table.law == "library" for table in scene.contact.values()])
        followed = model.rows.followed
        law = friction_law(contact, approach, sample.values) if "T" in followed else None
        forces = PeriodForces(
            sample.laws, yields[contact.interface], contact.w, eq.g, sample.friction, followed, law
        )
        damped = reduction.damped(approach)
        return SampleCycles(
            model, sample.brake.point, forces, eq.p > 0, damped, self._faces, contact.T
        )


def limit_cycles(
    model: Model,
    values: Mapping[str, float | str] | None = None,
    approach: str | None = None,
    sample: int = 0,
) -> list[dict[str, Any]]:
    """Limit cycles of the growing modes of a sample, each alone.

    Args:
        model: the scene, see ``prepare``.
        values: scalars of the scene, as in ``Model.modes``.
        approach: one of the scene's; its first if None.
        sample: number of the sample.

    Returns:
        One record for each cycle: ``mode``, ``outcome`` and the measures of limit_cycle.csv;
        ``branch``, amplitude [m] and alpha + i omega [1/s] of the points of its branch.

    Raises:
        SceneError: the scene has no section [limit_cycle].
    """
    if "limit cycles" not in model.study.beside:
        raise SceneError(f"{model.scene.file}: limit_cycle: the section is missing")
    found = model.work_beside("limit cycles", values, approach, sample)
    points = np.array([found["branch_amplitude"], found["branch_s"]])
    rows = zip(found["cycle_mode"], found["cycle_kind"], found["cycle_values"], strict=True)
    return [
        {"mode": int(i), "outcome": str(kind), "branch": points[:, found["branch_mode"] == i]}
        | dict(zip(map(str, found["cycle_names"]), row, strict=True))
        for i, kind, row in rows
    ]
