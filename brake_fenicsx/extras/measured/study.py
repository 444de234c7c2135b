"""Modes of a part against those of its test: table, MAC matrix and picture.

Measured and computed modes are paired by the modal assurance criterion (MAC). Computed modes of
nearly equal frequencies, as the doublets of a disc, span a plane in which any combination is a
mode: a measured shape is compared with its best approximation in it.

Reference: R. J. Allemang, Sound and Vibration 37(8) (2003) 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.errors import SceneError
from brake_fenicsx.mac import mac
from brake_fenicsx.report import style
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.scene import Scene, read_scene

from .part_modes import PartModes, part_modes, shapes_at
from .universal import ModalTest, read_modes

Cells = Sequence[AnyArray]

# Least MAC of a pair; largest ratio of its frequencies; frequencies of a doublet differ by less.
LEAST, FARTHEST, DOUBLET = 0.5, 2.0, 5e-3
# A combination of a doublet counts if the measured directions see this share of the one seen best.
SEEN = 0.1
# Modes are computed up to this multiple of the highest measured frequency.
BEYOND = 1.3
REMEDY = (
    "correct the unit (dataset 164, metres if there is none), or give nodes in the axes of the"
    " scene"
)
TESTED = "test_mode", "test_frequency_hz", "test_damping_ratio"
COLUMNS = *TESTED, "model_mode", "model_frequency_hz", "difference", "mac", "combined"


@dataclass(frozen=True, slots=True)
class Pairs:
    """Measured modes and the computed ones that they are.

    Attributes:
        mac: of every measured and computed mode, those of doublets combined, shape (tests, modes).
        mode: number of the computed mode of each measured one, -1 for none, shape (tests,).
        combined: modes of the computed doublet (or larger group), 1 for a mode by itself, (modes,).
    """

    mac: Array
    mode: Index
    combined: Index


def paired(measured: Complex, tested: Array, shapes: Array, frequency: Array) -> Pairs:
    """Pair measured with computed modes so that the sum of their MAC is largest.

    Args:
        measured: shapes in the measured directions, shape (tests, directions).
        tested: their frequencies [Hz], ascending.
        shapes: computed shapes in the same directions, shape (modes, directions).
        frequency: their frequencies [Hz], ascending.

    Returns:
        The pairs of at least the least MAC.
    """
    group = np.concatenate([[0], np.cumsum(np.diff(frequency) > DOUBLET * frequency[1:])])
    members = [np.flatnonzero(group == g) for g in range(group[-1] + 1)]
    span = np.column_stack([_in_span(measured, shapes[own]) for own in members])[:, group]
    apart = np.abs(np.log(tested[:, None] / frequency))
    span[apart > np.log(FARTHEST)] = 0.0
    mode = np.full(len(measured), -1)
    # All of a group have the same MAC here: the one that has most of the measured shape.
    alone = mac(measured.T, shapes.astype(complex).T)
    for i, j in zip(*linear_sum_assignment(-span - 1e-3 * alone), strict=True):
        if span[i, j] >= LEAST:
            mode[i] = j
    combined = shapes.astype(complex)
    for own in members:
        if len(own) > 1:
            combined[own] = _combined(shapes[own], own, measured, mode)
    size = np.array([len(members[g]) for g in group])
    return Pairs(mac(measured.T, combined.T), mode, size)


def _in_span(measured: Complex, shapes: Array) -> Array:
    """MAC of measured shapes with their projections on the span of some shapes, shape (tests,)."""
    u, s, _ = np.linalg.svd(shapes.T, full_matrices=False)
    inside = measured @ u[:, s > SEEN * s[0]]
    return np.asarray(np.sum(np.abs(inside) ** 2, axis=1) / np.sum(np.abs(measured) ** 2, axis=1))


def _combined(shapes: Array, group: Index, measured: Complex, mode: Index) -> Complex:
    """Combinations of a group: the best ones for its measured partners, then what is left."""
    test = [int(np.flatnonzero(mode == j)[0]) if j in mode else -1 for j in group]
    used = np.array([i >= 0 for i in test])
    if not used.any():
        return shapes.astype(complex)
    C = np.linalg.lstsq(shapes.T.astype(complex), measured[[i for i in test if i >= 0]].T, SEEN)[0]
    turn = np.zeros((len(group), len(group)), complex)
    turn[:, used] = C
    turn[:, ~used] = np.linalg.svd(C)[0][:, C.shape[1] :]
    return np.asarray(turn.T @ shapes)


def correlate(
    scene: str | Path,
    test: str | Path,
    part: str | None = None,
    supported: bool = False,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    write: bool = True,
) -> str:
    """Compare the modes of a part with measured ones.

    Processes do the same, each for itself: PETSc waits at its end for one that has not used it.

    Args:
        scene: path of the scene.
        test: universal file of the test.
        part: name of the part; may be left out where the scene has one.
        supported: with the supports, springs and masses of the part's faces; free if not.
        directory: where correlation.csv, mac.csv and correlation.png, .svg are written;
            SCENE-correlation in the working directory if not given.
        overrides: "key=value" replacements in the scene.
        write: whether this process writes the files.

    Returns:
        The table and where the files are, for the terminal.

    Raises:
        SceneError: scene, test or part is wrong; nothing was written.
    """
    parsed = read_scene(scene, overrides)
    name = part_name(parsed, part)
    measured = read_modes(test)
    highest = BEYOND * float(measured.frequency.max())
    modes = part_modes(parsed, name, measured.points, highest, supported)
    if not modes.frequency.size:
        raise SceneError(f"""{measured.file}: part {name!r} has no elastic mode below {highest:.0f}
            Hz, {BEYOND} times the highest measured frequency; check materials and --part""")
    values, distance, size = shapes_at(modes, measured.points)
    _check_extent(measured, name, size)
    labels = [f"node {n}" for n in measured.label]
    check_distance(measured.file, labels, measured.points, name, distance, size)
    values = np.einsum("pac,pcm->pam", measured.axes, values)
    tested, computed, seen = measured.frequency, modes.frequency, measured.seen
    pairs = paired(measured.shapes[:, seen], tested, values[seen].T, computed)
    rows = beside(
        pairs.mode,
        (np.arange(1, tested.size + 1), tested, measured.damping),
        (np.arange(1, computed.size + 1), computed, pairs.combined),
        (computed / tested[:, None] - 1, pairs.mac),
    )
    rows = [[*row[:5], *row[6:], row[5]] for row in rows]
    folder = Path(directory or Path.cwd() / f"{parsed.file.stem}-correlation")
    if write:
        folder.mkdir(parents=True, exist_ok=True)
        write_rows(folder / "correlation.csv", COLUMNS, rows)
        heads = ("test_mode", "test_frequency_hz", "model_mode", "model_frequency_hz", "mac")
        each = zip(np.ndindex(*pairs.mac.shape), pairs.mac.ravel(), strict=True)
        cells = ([i + 1, tested[i], j + 1, computed[j], mac_of] for (i, j), mac_of in each)
        write_rows(folder / "mac.csv", heads, cells)
        _draw(folder, measured, modes, pairs)
    held = "supported" if supported else "free"
    return (
        f"part {name}, {held}: {modes.rigid} rigid-body modes left out;"
        f" {len(measured.points)} points, {measured.seen.sum()} directions, at most"
        f" {1e3 * distance.max():.3g} mm from the surface (median"
        f" {1e3 * np.median(distance):.3g} mm)\n"
        f"{text_table(COLUMNS, rows)}\n"
        f"open {folder / 'correlation.png'}"
    )


def part_name(scene: Scene, name: str | None) -> str:
    """The part that was named, or the only one."""
    known = [n for n, part in scene.parts.items() if part.matrices is None]
    if name is None and len(known) != 1:
        which = (
            f"{', '.join(known)}; name one with --part" if known else "no part; write [parts.NAME]"
        )
        raise SceneError(f"{scene.file}: parts: the scene has {which}")
    if name is not None and name not in known:
        given = "given by matrices: correlate it in the code that wrote them"
        why = given if name in scene.parts else "no such part"
        raise SceneError(f"""{scene.file}: --part {name}: {why}; of parts with a mesh there are
            {", ".join(known)}""")
    return name or known[0]


def _check_extent(measured: ModalTest, part: str, size: Array) -> None:
    """Refuse points that all lie in one place of the part."""
    extent = float(np.ptp(measured.points, axis=0).max())
    if extent < size.min():
        raise SceneError(f"""{measured.file}: all nodes lie within {1e3 * extent:.3g} mm, half a
            facet of part {part!r} ({1e3 * size.min():.3g} mm): {REMEDY}""")


def check_distance(
    file: Path, label: Sequence[object], points: Array, part: str, distance: Array, size: Array
) -> None:
    """Refuse points that do not lie on a part.

    Args:
        file: that has them.
        label: their names.
        points: positions [m], shape (points, 3).
        part: the part.
        distance: to its surface [m], shape (points,).
        size: half a facet there [m], shape (points,).

    Raises:
        SceneError: a point is off by more than half a facet.
    """
    i = int(np.argmax(distance / size))
    if distance[i] > size[i]:
        place = ", ".join(f"{1e3 * x:.4g}" for x in points[i])
        raise SceneError(f"""{file}: {label[i]} at ({place}) mm is {1e3 * distance[i]:.4g} mm from
            the surface of part {part!r}, more than half a facet ({1e3 * size[i]:.3g} mm):
            {REMEDY}""")


def beside(mode: Index, tests: Cells, modes: Cells, both: Cells) -> list[list[Value]]:
    """Measured resonances beside the modes that they are, then the modes that have none.

    Args:
        mode: number of the mode of each resonance, -1 for none, shape (tests,).
        tests: cells of the resonances, each of shape (tests,).
        modes: cells of the modes, each of shape (modes,).
        both: cells of pairs, each of shape (tests, modes).
    """
    alone = np.setdiff1d(np.arange(modes[0].size), mode)
    places = [((i,), (int(j),), (i, int(j))) for i, j in enumerate(mode)]
    places += [((-1,), (int(j),), (-1, int(j))) for j in alone]
    return [
        [None if min(at) < 0 else cells[at].item()
         for at, table in zip(place, (tests, modes, both), strict=True) for cells in table]
        for place in places
    ]  # fmt: skip


def _draw(folder: Path, measured: ModalTest, modes: PartModes, pairs: Pairs) -> None:
    """MAC matrix, pairs framed, and beside it the difference of their frequencies."""
    with style.house_style():
        height = float(np.clip(1.4 + 0.27 * len(pairs.mac), 2.6, 9.0))
        figure, axes = style.new_figure(1, 2, height, sharey=True, width_ratios=[3, 1])
        _draw_mac(axes[0, 0], measured, modes, pairs)
        axis = axes[0, 1]
        rows = np.flatnonzero(pairs.mode >= 0)
        change = 100 * (modes.frequency[pairs.mode[rows]] / measured.frequency[rows] - 1)
        axis.axvline(0.0, color=style.GREY, linewidth=0.7)
        axis.barh(rows, change, height=0.6, color=style.BLUE)
        widest = 2.2 * max(np.abs(change).max(initial=0.0), 0.1)
        axis.set_xlim(-widest, widest)
        for row, value in zip(rows, change, strict=True):
            side = "left" if value >= 0 else "right"
            axis.text(value, row, f" {value:+.2f} ", va="center", ha=side, fontsize=7)
        axis.set_xlabel("model against test [%]")
        axis.tick_params(left=False)
        style.panel(axis, "b", "Frequency")
        style.save(figure, folder, "correlation")


def _draw_mac(axis: style.Axes, measured: ModalTest, modes: PartModes, pairs: Pairs) -> None:
    tests, count = pairs.mac.shape
    image = axis.imshow(pairs.mac, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    if count <= 24:
        for i, j in np.argwhere(pairs.mac >= 0.1):
            dark = "white" if pairs.mac[i, j] > 0.6 else "black"
            axis.text(
                j, i, f"{pairs.mac[i, j]:.2f}", ha="center", va="center", color=dark, fontsize=6
            )
    rows = np.flatnonzero(pairs.mode >= 0)
    side = np.array([-0.5, 0.5, 0.5, -0.5, -0.5])
    for i, j in zip(rows, pairs.mode[rows], strict=True):
        axis.plot(j + side, i + np.roll(side, 1), color=style.VERMILION, lw=1.2, clip_on=False)
    axis.set_yticks(range(tests), [f"{f:.0f}" for f in measured.frequency])
    axis.set_xticks(range(count), [f"{f:.0f}" for f in modes.frequency], rotation=90)
    axis.set_ylabel("measured mode [Hz]")
    axis.set_xlabel("computed mode [Hz]")
    axis.figure.colorbar(image, ax=axis, label="MAC [-]", shrink=0.8)
    style.panel(axis, "a", "Modal assurance criterion, pairs framed")
