"""Constants of a part's material from its resonances, as inputs of a study.

Several specimens are identified one by one. What a next specimen may have is normal in the
logarithms: the mean of the specimens, and the mean of their covariances plus the scatter of their
means (law of total variance).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.build.material_table import constants
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.folder.log import logger
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.scene import MaterialTable, Scene, read_scene
from brake_fenicsx.scene.read import toml_text, with_values, write_text
from brake_fenicsx.scene.units import in_unit_of, to_si

from .posterior import Peaks, Posterior, VariedBody, fill_basis, identified, read_peaks
from .study import beside, part_name

# Modes are computed up to this multiple of the highest peak, and no more than so many.
BEYOND, MOST_MODES = 1.2, 400
# A constant is not determined if its standard deviation is more than this share of the prior's.
UNDETERMINED = 0.8
# Standard deviations of a 95 % interval; relative error of a Q factor.
NORMAL, Q_ERROR = 1.96, 0.1
CONSTANTS = ("constant", "unit", "scene", "identified", "low", "high", "of_prior")
PEAKS = ("specimen", "peak_hz", "mode", "mode_hz", "difference")


def identify(
    scene: str | Path,
    peaks: str | Path,
    part: str | None = None,
    material: str | None = None,
    supported: bool = False,
    prior: float = 0.3,
    error: float = 0.005,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    write: bool = True,
    updated: str | Path | None = None,
) -> str:
    """Identify the constants of a material from the resonances of a part.

    Args:
        scene: path of the scene.
        peaks: see ``read_peaks``.
        part: name of the part; may be left out where the scene has one.
        material: of the part; may be left out for its lining, or where it has one material.
        supported: with the supports, springs and masses of the part's faces; free if not.
        prior: standard deviation of the logarithm of each constant around the scene's.
        error: standard deviation of the logarithm of a frequency.
        directory: where constants.csv, peaks.csv and random.toml are written; SCENE-identified in
            the working directory if not given.
        overrides: "key=value" replacements in the scene.
        write: whether this process writes the files.
        updated: file that gets the text of the scene with the identified constants: the scene's
            own, or a new one beside it.

    Returns:
        Tables for the terminal.

    Raises:
        SceneError: scene, peaks, part or material is wrong; nothing was written.
    """
    if not (prior > 0 and error > 0):
        raise SceneError(f"--prior {prior:g}, --error {error:g}: must be positive")
    parsed = read_scene(scene, overrides)
    part = part_name(parsed, part)
    material = _material(parsed, part, material)
    specimens = read_peaks(peaks)
    highest = BEYOND * max(s.frequency[-1] for s in specimens)
    scene_file = None if updated is None else _target(parsed, updated)
    body = VariedBody(parsed, part, material, highest, supported)
    if scene_file is not None:  # refused before it takes time
        with_constants(parsed, material, _values(parsed, material, body, body.nominal))
    where = f"{peaks}: part {part!r}"
    if (count := body.count()) > MOST_MODES:
        raise SceneError(f"""{where} has {count} modes below {highest:.4g} Hz, {BEYOND} times the
            highest peak; name the column frequency_hz if it is in Hz, or leave out the highest
            peaks""")
    lowest = fill_basis(body, prior)
    specimens = [_above(where, s, lowest * np.exp(-3 * prior), body) for s in specimens]
    each = [identified(body, s.frequency, prior, error) for s in specimens]
    for s, end in zip(specimens, each, strict=True):
        _say_misfit(s, end, error)
    theta, covariance = _pooled(each)
    unit = _unit_of_moduli(parsed.table["materials"][material])
    shown = _constants(material, unit, body, theta, covariance, prior)
    losses = [_loss(parsed, part, material, *pair) for pair in zip(specimens, each, strict=True)]
    rows = [row for pair in zip(specimens, each, strict=True) for row in _peak_rows(*pair)]
    folder = Path(directory or Path.cwd() / f"{parsed.file.stem}-identified")
    block = _block(material, unit, body.names, theta, covariance, np.array(losses))
    if write:
        folder.mkdir(parents=True, exist_ok=True)
        write_rows(folder / "constants.csv", CONSTANTS, shown)
        write_rows(folder / "peaks.csv", PEAKS, rows)
        with whole_file(folder / "random.toml") as file:
            file.write_text(block, encoding="utf-8")
    said = [text_table(PEAKS, rows), "", text_table(CONSTANTS, shown)]
    if loose := [str(row[0]) for row in shown if float(row[-1] or 0.0) > UNDETERMINED]:
        said.append(f"not determined by these peaks (as the prior): {', '.join(loose)}")
    said += ["", block, f"wrote {folder / 'random.toml'}"]
    if scene_file is not None:
        values = _values(parsed, material, body, theta, losses)
        text = with_constants(parsed, material, values)
        said.append(f"wrote {', '.join(values)} into {scene_file}")
        if "loss" not in values and np.isfinite(losses).any():
            loss = f"materials.{material}.loss = {np.nanmean(losses):.3g}"
            said.append(f"{loss} is not written: the scene has none; write it there")
        if write:
            write_text(scene_file, text)
    return "\n".join(said)


def _values(
    scene: Scene, material: str, body: VariedBody, theta: Array, losses: Sequence[float] = ()
) -> dict[str, float]:
    """Constants by name, and the loss factor where the scene has one and peaks tell it."""
    values = {name: float(v) for name, v in zip(body.names, np.exp(theta), strict=True)}
    told = [loss for loss in losses if np.isfinite(loss)]
    return values | (
        {"loss": float(np.mean(told))} if told and scene.materials[material].loss else {}
    )


def _material(scene: Scene, part: str, name: str | None) -> str:
    """The material that was named, the lining's, or the only one."""
    used = scene.parts[part].material
    layers = {"": used} if isinstance(used, str) else used
    known = sorted({*layers.values()})
    chosen = name or layers.get("lining") or (known[0] if len(known) == 1 else None)
    if chosen not in known:
        hint = "name one with --material" if name is None else f"--material {name}: not of the part"
        raise SceneError(f"""{scene.file}: parts.{part}: has the materials {", ".join(known)};
            {hint}""")
    return str(chosen)


def _above(where: str, peaks: Peaks, limit: float, body: VariedBody) -> Peaks:
    """The peaks that may be elastic modes."""
    low = peaks.frequency < limit
    if low.all():
        raise SceneError(f"""{where}: specimen {peaks.specimen}: all peaks lie below
            {min(limit, body.highest):.4g} Hz, where the part has no mode; name the column
            frequency_khz if it is in kHz, or check materials and dimensions""")
    if low.any():
        logger.warning(
            "%s: specimen %s: %d peaks below %.4g Hz left out: below the first mode whatever the"
            " constants, taken as rigid-body motions", where, peaks.specimen, low.sum(), limit,
        )  # fmt: skip
    kept = Peaks(peaks.specimen, peaks.frequency[~low], peaks.q[~low])
    if kept.frequency.size < len(body.names):
        logger.warning(
            "%s: specimen %s: %d peaks for %d constants (%s): they determine no more than %d"
            " combinations", where, peaks.specimen, kept.frequency.size, len(body.names),
            ", ".join(body.names), kept.frequency.size,
        )  # fmt: skip
    return kept


def _say_misfit(peaks: Peaks, end: Posterior, error: float) -> None:
    used = end.mode >= 0
    off = np.log(peaks.frequency[used] / end.modes.frequency[end.mode[used]])
    rms = float(np.sqrt(np.mean(off**2))) if used.any() else 0.0
    below = np.flatnonzero(end.modes.frequency < peaks.frequency[-1])
    unheard = np.setdiff1d(below, end.mode).size
    said = "specimen %s: %d of %d peaks have a mode, rms %.3g %%; %d steps, basis within %.1e"
    counts = peaks.specimen, used.sum(), used.size
    logger.info(said, *counts, 100 * rms, end.steps, end.basis_error)
    if unheard or not used.all():
        logger.warning(
            "specimen %s: %d peaks fit no mode and are left out; %d modes below the highest peak"
            " have no peak and are taken as not heard", peaks.specimen, np.sum(~used), unheard,
        )  # fmt: skip
    if rms > 1.5 * error or used.sum() < 0.8 * used.size:
        logger.warning(
            "specimen %s: the model does not fit within the stated error of %.3g %%: the intervals"
            " are too narrow; check dimensions, density and layers, or state a larger --error",
            peaks.specimen,
            100 * error,
        )


def _pooled(each: Sequence[Posterior]) -> tuple[Array, Array]:
    """Mean and covariance of the logarithms for a next specimen."""
    means = np.array([end.theta for end in each])
    covariance = np.mean([end.covariance for end in each], axis=0)
    if len(each) > 1:
        covariance = covariance + np.atleast_2d(np.cov(means.T))
    return means.mean(axis=0), covariance


def _constants(
    material: str, unit: str, body: VariedBody, theta: Array, covariance: Array, prior: float
) -> list[list[Value]]:
    rows: list[list[Value]] = []
    scale = to_si(f"1 {unit}", "Pa")
    for i, name in enumerate(body.names):
        sd = float(np.sqrt(covariance[i, i]))
        ends = np.exp(theta[i] + NORMAL * sd * np.array([0.0, -1.0, 1.0]))
        values, said = np.array([np.exp(body.nominal[i]), *ends]), "-"
        if not name.startswith("nu"):
            values, said = values / scale, unit
        rows.append([f"materials.{material}.{name}", said, *map(float, values), sd / prior])
    return rows


def _unit_of_moduli(table: Mapping[str, Any]) -> str:
    """Unit in which a table of a scene writes a modulus."""
    for written in table.values():
        text = written[0] if isinstance(written, list) else written
        with suppress(ValueError):
            to_si(text, "Pa")
            return str(in_unit_of(1.0, text, "Pa")).partition(" ")[2]
    return "GPa"


def _loss(scene: Scene, part: str, material: str, peaks: Peaks, end: Posterior) -> float:
    """Loss factor from the Q factors: 1 / Q is the mean of the materials', by strain energy."""
    used = (end.mode >= 0) & np.isfinite(peaks.q)
    if not used.any():
        return np.nan
    share, q = end.modes.share[end.mode[used]], peaks.q[used]
    table = scene.parts[part].material
    names = {table} if isinstance(table, str) else {*table.values()}
    others = [scene.materials[name].loss for name in names - {material}]
    rest = 1 / q - (1 - share) * (np.mean(others) if others else 0.0)
    return float(np.sum(share * rest * q**2) / np.sum(share**2 * q**2))


def _peak_rows(peaks: Peaks, end: Posterior) -> list[list[Value]]:
    """Measured peaks with their modes, then modes below the highest one that no peak has."""
    f = end.modes.frequency
    f = f[: max(int(np.sum(f < peaks.frequency.max(initial=0.0))), end.mode.max(initial=-1) + 1)]
    differences = [f / peaks.frequency[:, None] - 1]
    rows = beside(end.mode, [peaks.frequency], [np.arange(1, f.size + 1), f], differences)
    return [[peaks.specimen, *row] for row in rows]


def _block(
    material: str, unit: str, names: Sequence[str], theta: Array, covariance: Array, losses: Array
) -> str:
    """[samples.random] of a scene with the identified constants."""
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    keys = [f'"materials.{material}.{name}"' for name in names]
    lines = ["[samples.random]"]
    for i, name in enumerate(names):
        mean, text = np.exp(theta[i] + 0.5 * sd[i] ** 2), 'law = "lognormal"'
        for word, v in (("mean", mean), ("sd", mean * np.sqrt(np.expm1(sd[i] ** 2)))):
            number = float(f"{v:.6g}") if name[:2] == "nu" else in_unit_of(v, f"1 {unit}", "Pa")
            text += f", {word} = {toml_text(number)}"
        others = ", ".join(f"{key} = {correlation[i, j]:.4f}" for j, key in enumerate(keys[:i]))
        text += f", correlation = {{ {others} }}" if others else ""
        lines.append(f"{keys[i]} = {{ {text} }}")
    if np.isfinite(losses).any():
        mean = np.nanmean(losses)
        sd_loss = np.hypot(Q_ERROR * mean, np.nanstd(losses))
        text = f'law = "lognormal", mean = {mean:.4g}, sd = {sd_loss:.3g}'
        lines.append(f'"materials.{material}.loss" = {{ {text} }}')
    return "\n".join(lines) + "\n"


def _target(scene: Scene, path: str | Path) -> Path:
    """The scene's file or a new one beside it, where its paths are not lost."""
    file, own = Path(path), scene.file
    if file.resolve() != own.resolve():
        if file.exists():
            raise SceneError(f"--write {file}: is there already; name the scene or a new file")
        if file.resolve().parent != own.resolve().parent:
            raise SceneError(f"""--write {file}: name a file in {own.resolve().parent}, from which
                the paths of the scene start""")
    return file


def with_constants(scene: Scene, material: str, values: Mapping[str, float]) -> str:
    """Text of the scene's file with other constants of a material.

    Args:
        scene: the scene.
        material: its name.
        values: constant, as in ``constants``, or "loss" -> value, SI.

    Raises:
        SceneError: the file does not write one of them.
    """
    keys = _keys(scene.materials[material], values)
    return with_values(scene, {("materials", material, key): v for key, v in keys.items()})


def _keys(table: MaterialTable, values: Mapping[str, float]) -> dict[str, Any]:
    """Keys of a material table and their values; engineering constants of one are orthotropic."""
    if not any("_" in name for name in values):
        return dict(values)
    c = constants(table) | dict(values)
    ratios = [c["nu_12"], c["nu_31"] * c["E_1"] / c["E_3"], c["nu_32"] * c["E_2"] / c["E_3"]]
    new: dict[str, Any] = {} if table.model == "orthotropic" else {"model": "orthotropic"}
    new |= {"E": [c[f"E_{i}"] for i in "123"], "nu": ratios}
    new |= {"G": [c[f"G_{ij}"] for ij in ("23", "13", "12")]}
    return new | {name: v for name, v in values.items() if name == "loss"}
