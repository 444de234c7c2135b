"""Arrays behind the surface and contact figures, from the stages' own results."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.store import Store
from brake_fenicsx.micro import LawRecipe, LawSettings, load_laws, solve_contact
from brake_fenicsx.surface import SurfaceStatistics, radial_psd
from brake_fenicsx.surface.hdf import iso_parameters, kernel_density

MOMENTS = ("mean", "median", "S_q", "S_sk", "S_ku")
MOMENT_ERRORS = ("mean_error", "S_q_error", "S_sk_error", "S_ku_error")
MAP_LOADS = (1e-4, 1e-3, 1e-2, 5e-2)  # of figure 7, p / E*; lower where the laws end lower


def surface_arrays(
    stats: SurfaceStatistics, recipe: LawRecipe | None, seed: int = 0
) -> dict[str, Any]:
    """Content of surface.npz.

    Args:
        stats: statistics of the scan, or given by numbers.
        recipe: what artificial surfaces are made from, if the scene makes any.
        seed: of the laws; the artificial surface is that of the first of them.

    Returns:
        Arrays by name; what there is no scan or no artificial surface for is left out.
    """
    fit = stats.bifractal
    q = np.asarray(np.geomspace(*fit.band, 200), float)
    z = np.linspace(-5, 5, 401) * stats.S_q
    numbers = surface_numbers(stats)
    out: dict[str, Any] = {
        "fit_q": q, "fit_C": fit(q), "q_band": np.array(fit.band),
        "hdf_z": z, "hdf_density": stats.hdf.pdf(z), "stats": np.array(json.dumps(numbers)),
    }  # fmt: skip
    lowest, highest = (stats.spectrum.form or fit).band[0], fit.band[1]
    out["spectrum_q"] = np.geomspace(1e-2 * lowest, 10 * highest, 1000)
    low = recipe.low if recipe else "flat"
    out["spectrum_C"] = stats.spectrum(out["spectrum_q"], low)
    if stats.psd is not None and (topos := stats.topographies):
        out |= {"q": stats.psd.q, "C": stats.psd.C, "q_band": np.array(stats.psd.band)}
        heights = topos[0].heights if len(topos) == 1 else np.array([t.heights for t in topos])
        out |= {"heights": heights, "size": topos[0].size}
        out["scan_C"] = np.array([s.psd.C for s in stats.scans if s.psd is not None])
    if recipe is not None:
        made = recipe.surface(seed, 0)
        psd = radial_psd(made)
        out |= {"artificial": made.heights, "artificial_size": made.size}
        out |= {"artificial_q": psd.q, "artificial_C": psd.C, "artificial_hdf_z": z}
        out["artificial_hdf_density"] = kernel_density(made.heights.ravel(), z)
    return out


def surface_numbers(stats: SurfaceStatistics) -> dict[str, Any]:
    """Parameters of a surface, and with several scans those of each.

    Args:
        stats: statistics of scans, or given by numbers.

    Returns:
        Values in SI units by name; a name with ``_error`` is a standard error. ``scans``: the same
        of each scan, with its file; ``scan_mean`` and ``scan_std``: mean and standard deviation
        over the scans of what all of them define.
    """
    fit = stats.bifractal
    names = ("c1", "c2", "ln_q_c", "ln_C0")
    numbers: dict[str, Any] = {n: getattr(stats, n) for n in MOMENTS}
    numbers |= {n: getattr(fit, n) for n in ("c1", "c2", "q_c", "C0")}
    numbers |= {f"{n}_error": e for n, e in zip(names, fit.errors, strict=True)}
    numbers["fit_rms"] = fit.rms
    found: dict[str, Any] = {}
    if stats.topography is not None:
        found = dict(iso_parameters(stats.topography))
    each = [surface_numbers(scan) for scan in stats.scans]
    if each:
        common = [n for n in each[0] if not n.endswith("_error") and all(n in e for e in each)]
        columns = {n: np.array([e[n] for e in each]) for n in common}
        mean = {n: float(v.mean()) for n, v in columns.items()}
        std = {n: float(v.std(ddof=1)) for n, v in columns.items()}
        # What surfaces are not made from has its mean over the scans.
        own = [n for n in common if n not in numbers]
        found |= {n: mean[n] for n in own}
        found |= {f"{n}_error": std[n] / np.sqrt(len(each)) for n in (*own, "median")}
        files = [Path(t.source).name for t in stats.topographies]
        counts = [{"missing": s.missing, "outliers": s.outliers} for s in stats.scans]
        rows = zip(files, counts, each, strict=True)
        numbers["scans"] = [{"file": file, **lost, **row} for file, lost, row in rows]
        numbers |= {"scan_mean": mean, "scan_std": std}
    if stats.each:
        found |= dict(zip(MOMENT_ERRORS, stats.errors, strict=True))
    return numbers | {n: v for n, v in found.items() if np.isfinite(v)}


def contact_maps(directory: Path) -> None:
    """Press the surface of the first law at several loads; writes contact_maps.npz.

    It is pressed like the law, with its hardness and its boundary, up to the end of the law.
    Nothing is done without laws, or twice.
    """
    store = Store(directory)
    surface = store.load("surface.npz")
    made = store.path("laws.npz").exists() and not store.path("contact_maps.npz").exists()
    if surface is None or not made:
        return
    how, names = load_laws(store.path("laws.npz")).settings, [f.name for f in fields(LawSettings)]
    heights, size = (surface.get(n, np.empty(0)) for n in ("artificial", "artificial_size"))
    if {*names} - {*how} or [*heights.shape] != [*how["shape"]]:
        raise SceneError(f"""{store.path("laws.npz")}: made by an older version; run the scene again
            in a new folder""")
    settings = LawSettings(**{name: how[name] for name in names})
    loads = np.array(MAP_LOADS) * min(1.0, settings.highest / settings.E_star / MAP_LOADS[-1])
    solved = [
        solve_contact(
            heights, size, settings.E_star, load=p * settings.E_star * float(np.prod(size)),
            boundary=settings.boundary, tol=settings.tolerance, hardness=settings.hardness,
        )
        for p in loads
    ]  # fmt: skip
    maps: dict[str, Any] = {"heights": heights, "size": size, "p_over_E": loads}
    maps["pressures"] = np.array([s.pressure for s in solved], dtype=np.float32)
    maps["area_fraction"] = np.array([s.area_fraction for s in solved])
    maps["separation"] = np.array([s.separation for s in solved])
    store.save("contact_maps.npz", **maps)
