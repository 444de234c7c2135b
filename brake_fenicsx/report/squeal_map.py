"""Content of the interactive squeal map: every mode as one point, a part of them where many."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.accuracy import eigenvalue_errors
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family, squeals

from .mode_cards import ModePictures

MOST = 20_000  # modes that a page holds
VERDICTS = {"stable": 0, "unstable": 1}


def squeal_map(
    run: RunData,
    families: Mapping[str, list[Family]],
    lead: str,
    pictures: ModePictures,
    most: int = MOST,
) -> dict[str, Any] | None:
    """What the template of the map shows.

    Args:
        run: the results.
        families: of each approach, the most severe first.
        lead: approach that is shown first.
        pictures: pictures of mode shapes.
        most: number of modes; of more than these a part is taken, squeal modes first.

    Returns:
        ``data`` for the script, columns of one length; ``shown`` of ``total`` modes and how they
        were selected; None without modes.
    """
    if run.modes is None or run.modes["mode"].size == 0:
        return None
    names, modes = run.approaches, run.modes
    number = np.full(len(modes["mode"]), -1, dtype=np.int8)
    for j, name in enumerate(names):
        number[run.squeal.of_good(name)] = j
    hits = squeals(modes, run.threshold)
    total = int(np.sum(number >= 0))
    chosen, selection = _selected(number >= 0, hits, most)
    if chosen.size == 0:
        return None
    verdict = np.array([VERDICTS.get(str(v), 2) for v in modes["verdict"][chosen]])
    own_errors = eigenvalue_errors({
        key: modes[key][chosen] for key in ("real_1_s", "frequency_hz", "error_estimate")
    })  # fmt: skip
    partner = modes["partner"][chosen] if "partner" in modes else np.full(chosen.size, np.nan)
    data = {
        "names": [run.label(name) for name in names],
        "approach": number[chosen].tolist(),
        "sample": modes["sample"][chosen].tolist(),
        "mode": modes["mode"][chosen].tolist(),
        "frequency": _rounded(modes["frequency_hz"][chosen], 7),
        "damping": _rounded(modes["damping"][chosen], 4),
        "error": _rounded(own_errors, 2),
        "verdict": verdict.tolist(),
        "family": modes["family"][chosen].astype(int).tolist(),
        "partner": np.where(np.isnan(partner.astype(float)), -1, partner).astype(int).tolist(),
        "thinned": chosen.size < total,
        "families": {
            f"{names.index(name)}:{f.key}": {
                "khz": f.kilohertz,
                "share": f"{f.share.hits} of {f.share.n} samples",
                "shape": pictures.of_family(f),
            }
            for name, found in families.items() for f in found if f.key >= 0
        },
        "shapes": {
            f"{names.index(name)}:{sample}:{mode}": key
            for (name, sample, mode), key in pictures.by_mode.items() if name in names
        },
    }  # fmt: skip
    return {
        "data": data,
        "approaches": data["names"],
        "first": names.index(lead) if lead in names else 0,
        "threshold": f"{run.threshold:g}",
        "shown": int(chosen.size),
        "total": total,
        "selection": selection,
    }


def _selected(known: NDArray, hits: NDArray, most: int) -> tuple[NDArray, str]:
    """Rows of the table that are shown, and how they were taken: every n-th, squeal modes first."""
    squeal, others = np.flatnonzero(known & hits), np.flatnonzero(known & ~hits)
    if squeal.size + others.size <= most:
        return np.flatnonzero(known), "all"
    step = -(-squeal.size // (most // 2)) if squeal.size else 1
    kept = squeal[::step]
    rest = -(-others.size // max(most - kept.size, 1)) if others.size else 1
    said = "all squeal modes" if step == 1 else f"one in {step} of the squeal modes"
    return np.sort(
        np.concatenate([kept, others[::rest]])
    ), f"{said} and one in {rest} of the others"


def _rounded(values: NDArray, digits: int) -> list[float | None]:
    """Numbers of few digits; None for what is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values.astype(float)]
