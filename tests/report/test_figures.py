"""Every figure from a synthetic run: it is there, it shows the data, and only where data are."""

import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import matplotlib.colors
import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection, PolyCollection

from brake_fenicsx.errors import SceneError
from brake_fenicsx.report.contact_figures import draw_contact_maps, draw_contact_pressure, draw_laws
from brake_fenicsx.report.figures import PLOTS, make_figures
from brake_fenicsx.report.input_figures import draw_driver_maps
from brake_fenicsx.report.sample_figures import (
    draw_convergence,
    draw_counts,
    draw_errors,
    draw_probability,
)
from brake_fenicsx.report.squeal_figures import draw_squeal_map
from brake_fenicsx.report.style import BLACK, GREY, house_style, save
from brake_fenicsx.report.surface_figures import draw_artificial, draw_statistics, draw_topography
from brake_fenicsx.report.sweep_figures import draw_branches
from brake_fenicsx.results.tables import MODES, write_rows
from run_tables import EVENTS, SWEEP, read_run

NEEDS = {
    "modes.csv": {
        "figure9_squeal_map", "probability_per_band", "unstable_per_sample",
        "convergence", "eigenvalue_errors",
    },
    "contact.csv": {"contact_pressure"},
    "laws.npz": {"figure8_laws"},
    "surface.npz": {
        "figure4_topography", "figure5_statistics", "bearing_curve", "figure6_artificial",
    },
    "contact_maps.npz": {"figure7_contact_maps"},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(run_directory):
    return read_run(run_directory)


def ink(path: Path) -> tuple[float, int]:
    """Share of pixels that are not white, and number of colours."""
    image = (matplotlib.image.imread(path)[:, :, :3] * 255).astype(np.uint32)
    packed = image @ np.array([65536, 256, 1], dtype=np.uint32)
    return float(np.mean(packed < 0xFAFAFA)), len(np.unique(packed))


def test_all_figures_are_drawn_and_none_is_blank_or_cut_off(drawn, cut_off):
    _, written = drawn
    assert cut_off == []
    # Those of extras, which this run has not, are drawn in their own tests.
    names = [p.name for p in PLOTS if not p.name.startswith(("limit_cycle", "states"))]
    expected = [f"{name}.{kind}" for name in names for kind in ("png", "svg")]
    assert [path.name for path in written] == expected
    for path in written:
        if path.suffix == ".png":
            share, colours = ink(path)
            assert share > 0.02, path.name
            assert colours > 30, path.name
        else:
            assert ElementTree.parse(path).getroot().tag.endswith("svg")


@pytest.mark.parametrize("name", NEEDS)
def test_what_is_absent_is_not_drawn(run_directory, tmp_path, without_pixels, name):
    shutil.copy(run_directory / name, tmp_path / name)
    make_figures(read_run(tmp_path))
    assert {*without_pixels} == NEEDS[name]


def test_the_same_run_gives_the_same_bytes(run_directory, tmp_path, monkeypatch):
    """Of one figure: a file differs by what the library adds, the same in all."""
    few = [plot for plot in PLOTS if plot.name == "bearing_curve"]
    monkeypatch.setattr("brake_fenicsx.report.figures.PLOTS", few)
    contents = []
    before = dict(matplotlib.rcParams)
    for k in range(2):
        directory = tmp_path / str(k)
        directory.mkdir()
        shutil.copy(run_directory / "surface.npz", directory)
        contents.append([path.read_bytes() for path in make_figures(read_run(directory))])
    assert contents[0] == contents[1] and len(contents[0]) == 2
    assert dict(matplotlib.rcParams) == before


def test_pyplot_holds_no_figure(run):
    import matplotlib.pyplot as plt

    draw_laws(run)
    assert plt.get_fignums() == []


def test_topography_shows_the_heights_with_x_to_the_right(run):
    figure = draw_topography(run)
    image = figure.axes[0].images[0]
    z = run.surface["heights"].T * 1e6
    assert np.array_equal(np.isnan(z), np.ma.getmaskarray(image.get_array()))
    assert np.allclose(image.get_array().compressed(), z[np.isfinite(z)])
    assert np.allclose(image.get_extent(), [0, 1.8, 0, 1.4])
    assert f"{np.isnan(z).sum()} of {z.size} points missing" in figure.axes[0].get_title(
        loc="left"
    ) + (figure.axes[0].get_title())


def inside(figure, box):
    """Whether a box lies on the page of a figure [px], within one pixel."""
    page = figure.bbox
    corners = np.array([[box.x0, box.y0], [box.x1, box.y1]])
    return np.all(corners >= page.p0 - 1) and np.all(corners <= page.p1 + 1)


@pytest.mark.parametrize(("scans", "ratio"), [(2, 0.5), (5, 1.5), (12, 1.5)])
def test_labels_of_several_maps_stand_on_the_figure(tmp_path, save_scan, scans, ratio):
    z = np.random.default_rng(1).normal(size=(scans, 8, 8)) * 1e-6
    save_scan(tmp_path, z, [1e-3, ratio * 1e-3])
    run = read_run(tmp_path)
    with house_style():
        figure = draw_topography(run)
        FigureCanvasAgg(figure).draw()
        shown = [axis for axis in figure.axes if axis.get_visible()]
        assert all(inside(figure, axis.get_tightbbox()) for axis in shown)
    maps = [axis for axis in shown if axis.images]
    assert len(maps) == min(scans, 9) and all(axis.get_xlabel() for axis in maps)


@pytest.mark.parametrize(
    ("mean", "said"), [(7.48e-12, "$0$ µm"), (-1.03e-7, "$-0.103$ µm"), (2.56e-5, "$25.6$ µm")]
)
def test_numbers_of_the_heights_stand_beside_the_legend(run, mean, said):
    """A mean that levelling has made zero up to round-off is zero."""
    stats = {"mean": mean, "median": -7.94e-8, "S_q": 1.07e-6, "S_sk": -0.09, "S_ku": 2.82}
    surface = {**run.surface, "stats": np.array(json.dumps(stats))}
    with house_style():
        figure = draw_statistics(replace(run, surface=surface))
        FigureCanvasAgg(figure).draw()
        axis = figure.axes[0]
        (text,) = (t for t in axis.texts if "scan mean" in t.get_text())
        legend = axis.get_legend().get_window_extent()
        assert not text.get_window_extent().overlaps(legend)
    assert f"scan mean = {said}\n" in text.get_text()


def test_statistics_show_fit_band_and_residual(run):
    figure = draw_statistics(run)
    heights, psd, residual = figure.axes
    assert (psd.get_xscale(), psd.get_yscale()) == ("log", "log")
    texts = [t.get_text() for t in psd.get_legend().get_texts()]
    assert "$-2.01$ ± 0.04" in texts[2]
    curves = [line for line in psd.lines if len(line.get_xdata()) > 2]
    assert len(curves) == 2
    fit = residual.lines[0].get_ydata()
    assert np.all(fit > 0)
    area = sum(p.get_width() * p.get_height() for p in heights.patches)
    assert area == pytest.approx(1.0)


@pytest.mark.parametrize("stages", [["surface"], ["surface", "micro"]])
def test_surface_known_by_its_numbers_alone(stages, tmp_path, without_pixels):
    """Its report ended in an error once: there are no heights to draw, and no residual."""
    from brake_fenicsx.build.law_stage import law_recipe
    from brake_fenicsx.build.measured_surface import read_surface
    from brake_fenicsx.report import html
    from brake_fenicsx.report.figure_inputs import surface_arrays
    from brake_fenicsx.scene import read_scene

    scene = tmp_path / "numbers.toml"
    scene.write_text(
        f"stages = {stages!r}\n[surface.statistics]\nS_q = '3 um'\nS_ku = 4\n"
        "[micro]\npixels = 64\nE = '2 GPa'\n"
    )
    read = read_scene(scene)
    stats = read_surface(read)
    np.savez(tmp_path / "surface.npz", **surface_arrays(stats, law_recipe(read, stats)))
    run = read_run(tmp_path)
    assert draw_topography(run) is None
    heights, spectrum = draw_statistics(run).axes
    assert [line.get_label() for line in heights.lines] == ["as given"]
    (z, density) = heights.lines[0].get_data()
    assert np.sqrt(np.sum(z**2 * density) * (z[1] - z[0])) == pytest.approx(3.0, rel=1e-2)
    assert "as given" in spectrum.get_legend().get_texts()[-1].get_text()
    figure = draw_artificial(run)
    assert (figure is None) == ("micro" not in stages)
    if figure:
        shown = [axis for axis in figure.axes[:4] if axis.get_visible()]
        assert [axis.get_title()[:3] for axis in shown] == ["(a)", "(b)", "(c)"]
    page = html.write_report(read_run(tmp_path)).read_text()
    assert "The scene gives statistics in place of a scan" in page
    assert "instrument" not in page


def test_artificial_surface_stands_at_the_scale_of_the_scan(run):
    figure = draw_artificial(run)
    left, right = figure.axes[:2]
    assert left.get_xlim() == right.get_xlim() == (0, pytest.approx(2.825))
    assert left.images[0].get_clim() == right.images[0].get_clim()
    assert np.allclose(right.images[0].get_array(), run.surface["artificial"].T * 1e6)


def test_contact_maps_show_only_what_touches(run):
    figure = draw_contact_maps(run)
    maps = [axis for axis in figure.axes if axis.images]
    for axis, p in zip(maps[:6], run.maps["pressures"], strict=True):
        shown = axis.images[0].get_array()
        assert np.array_equal(~np.ma.getmaskarray(shown), p.T > 0)
    assert "real contact 30 %" in maps[5].get_title(loc="left") + maps[5].get_title()


def test_laws_are_all_drawn_on_linear_and_log_axes(run):
    figure = draw_laws(run)
    assert [axis.get_yscale() for axis in figure.axes] == ["linear", "log", "log"]
    for axis in figure.axes:
        (bundle,) = (c for c in axis.collections if isinstance(c, LineCollection))
        assert len(bundle.get_segments()) == 30
    first = figure.axes[0].collections[0].get_segments()[3]
    assert np.allclose(first[:, 0], run.laws["d"][3] * 1e6)
    assert np.allclose(first[:, 1], run.laws["p"][3] / 1e6)


def stiffness_band(run, number):
    """Panel of the stiffness of a number of laws, its black lines and its filled bands."""
    laws = {n: a[:number] if n in ("d", "p", "k", "v") else a for n, a in run.laws.items()}
    axis = draw_laws(replace(run, laws=laws)).axes[2]
    lines = [line for line in axis.lines if line.get_color() == BLACK]
    return axis, lines, [c for c in axis.collections if isinstance(c, PolyCollection)]


def test_stiffness_of_many_laws_has_its_median_and_band(run):
    """At one pressure: the stiffness of each law is p / u0, whose quantiles are known."""
    for number, drawn in ((4, False), (5, True), (30, True)):
        _, lines, bands = stiffness_band(run, number)
        assert len(lines) == len(bands) == drawn
    ((p, k),) = (line.get_data() for line in lines)
    u0 = run.laws["p"][:, 0] / run.laws["k"][:, 0]
    np.testing.assert_allclose(1e9 * k / (1e6 * p), np.median(1 / u0), rtol=2e-2)
    corners = bands[0].get_paths()[0].vertices
    share = 1e9 * corners[:, 1] / (1e6 * corners[:, 0])
    low, high = np.quantile(1 / u0, [0.05, 0.95])
    assert share.min() == pytest.approx(low, rel=2e-2)
    assert share.max() == pytest.approx(high, rel=2e-2)


def test_both_stiffnesses_of_laws_with_a_hardness_have_a_band(run):
    hard = replace(run, laws={**run.laws, "v": 3.0 * run.laws["k"]})
    _, lines, bands = stiffness_band(hard, 30)
    assert len(lines) == len(bands) == 2
    np.testing.assert_allclose(lines[1].get_ydata(), 3 * lines[0].get_ydata())


def points(axes, marker):
    groups = [c for c in axes.collections if isinstance(c, PathCollection)]
    found = {c.get_label().split(":")[0]: c.get_offsets() for c in groups}
    return found.get(marker, np.empty((0, 2)))


def test_squeal_map_shows_every_mode_of_every_good_sample(run):
    figure = draw_squeal_map(run)
    assert len(figure.axes) == 3
    for axis, approach in zip(figure.axes, run.approaches, strict=True):
        c = run.squeal.count(approach)
        shown = {name: points(axis, name) for name in ("neutral", "stable", "squeal")}
        assert sum(map(len, shown.values())) == c.modes
        assert len(shown["squeal"]) == c.unstable > 0
        assert np.all(shown["squeal"][:, 1] < 0)
        assert f"{c.squeal} of {c.modes} modes squeal" in (
            axis.get_title(loc="left") + axis.get_title()
        )
    assert len({axis.get_ylim() for axis in figure.axes}) == 1
    mine = (run.modes["approach"] == "classical") & (run.modes["verdict"] == "unstable")
    expected = np.column_stack([run.modes["frequency_hz"][mine] / 1e3, run.modes["damping"][mine]])
    assert np.allclose(points(figure.axes[0], "squeal"), expected)


def test_what_does_not_squeal_is_grey_above_the_line(run):
    """A line at the threshold, named; below it the modes of the tables."""
    threshold = 6e-3
    strict = replace(run, summary={"in_effect": {"stability": {"threshold": threshold}}})
    lines, left_out = [], 0
    for axis, approach in zip(draw_squeal_map(strict).axes, run.approaches, strict=True):
        c = strict.squeal.count(approach)
        weak, squeal = points(axis, "unstable, no squeal"), points(axis, "squeal")
        assert len(weak) == c.unstable - c.squeal
        left_out += len(weak)
        assert len(squeal) == c.squeal
        assert np.all(squeal[:, 1] < -threshold) and np.all(weak[:, 1] >= -threshold)
        assert {
            matplotlib.colors.to_hex(g.get_facecolor()[0])
            for g in axis.collections
            if g.get_label().startswith("unstable, no squeal")
        } <= {GREY}
        lines += [line for line in axis.lines if line.get_ydata()[0] == -threshold]
        assert "squeal: damping below -0.006" in {t.get_text() for t in axis.texts}
    assert len(lines) == len(run.approaches) and left_out > 0
    for draw in (draw_probability, draw_counts, draw_convergence):
        figure = draw(strict)
        words = [t.get_text() for a in figure.axes for t in a.texts] + [
            a.get_xlabel() for a in figure.axes
        ]
        assert any("damping below -0.006" in text for text in words), draw.__name__


def test_probability_bars_are_the_shares(run):
    figure = draw_probability(run)
    assert len(figure.axes) == 2
    bars = [p.get_height() for p in figure.axes[1].patches]
    assert len(bars) == 16
    assert max(bars) == pytest.approx(44 / 60)


def test_stable_single_run_leaves_no_mark_and_no_legend(run, tmp_path):
    """An empty line beyond the axes made the layout collapse."""
    single = run.modes["approach"] == "classical"
    assert single.any()
    verdict = np.where(single, "stable", run.modes["verdict"])
    calm = replace(run, modes={**run.modes, "verdict": verdict})
    figure = draw_probability(calm)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save(figure, tmp_path, "probability")
    assert all(axis.get_legend() is None for axis in figure.axes)
    assert "no squeal mode in the one run" in figure.axes[0].get_title("right")
    assert figure.axes[0].get_position().width > 0.7


def test_histogram_sums_to_one_per_approach(run):
    axis = draw_counts(run).axes[0]
    for bars in axis.containers:
        assert sum(p.get_height() for p in bars) == pytest.approx(1.0)
    assert len(axis.containers) == 2


def test_convergence_ends_at_the_final_share(run):
    figure = draw_convergence(run)
    ends = [line.get_ydata()[-1] for line in figure.axes[0].lines]
    final = [run.squeal.count(a) for a in ("parametric", "multi-scale")]
    assert ends == [c.squeal_samples / c.samples for c in final]


def test_pressure_is_drawn_on_both_pads_of_each_approach(run):
    figure = draw_contact_pressure(run)
    pads = [axis for axis in figure.axes if axis.get_title()]
    assert len(pads) == 6
    for axis in pads:
        (patches,) = (c for c in axis.collections if isinstance(c, PolyCollection))
        assert len(patches.get_paths()) == 8 * 19
    (patches,) = (c for c in pads[0].collections if isinstance(c, PolyCollection))
    polygon = patches.get_paths()[0].vertices[:4]
    sides = np.linalg.norm(np.diff(polygon, axis=0), axis=1)
    assert np.allclose(sides, 2.825)


def test_pressure_is_drawn_on_the_facets_where_they_are_known(run_directory, tmp_path):
    """One triangle for each element, two of the same facet drawn as one with their mean."""
    shutil.copy(run_directory / "contact.csv", tmp_path)
    contact = read_run(tmp_path).contact
    n = int(contact["element"].max()) + 1
    centre = np.column_stack([contact[c][:n] for c in "xyz"])
    shape = 1e-3 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    facet = np.arange(n)
    facet[1] = 0
    np.savez(tmp_path / "contact_faces.npz", corners=centre[:, None] + shape, facet=facet)
    figure = draw_contact_pressure(read_run(tmp_path))
    (patches,) = (c for c in figure.axes[0].collections if isinstance(c, PolyCollection))
    paths = patches.get_paths()
    assert len(paths) == 8 * 19 - 1
    assert np.allclose(paths[0].vertices[:3], 1e3 * (centre[0] + shape)[:, :2])
    p, w = contact["p"][:2], contact["area"][:2]
    assert patches.get_array()[0] == pytest.approx(np.sum(p * w) / np.sum(w) / 1e6)


def test_faces_that_stick_are_in_no_picture_of_the_pads(run):
    """They may lie anywhere on the brake: here a third of the elements."""
    n = int(run.contact["element"].max()) + 1
    corners = np.zeros((0, 4, 3))
    for kept, shown in ((3, 8 * 19), (2, 2 * 8 * 19 // 3)):
        slides = np.arange(n) % 3 < kept
        faces = {"corners": corners, "facet": np.full(n, -1), "slides": slides}
        known = replace(run, faces=faces)
        for figure in (draw_contact_pressure(known), draw_driver_maps(known)):
            pads = [axis for axis in figure.axes if axis.get_title()]
            for axis in pads:
                (patches,) = (c for c in axis.collections if isinstance(c, PolyCollection))
                assert abs(len(patches.get_paths()) - shown) <= 1
    none = {**faces, "slides": np.zeros(n, bool)}
    assert draw_contact_pressure(replace(run, faces=none)) is None
    assert draw_driver_maps(replace(run, faces=none)) is None


def test_error_curves_end_at_the_largest_error_of_each_approach(run):
    bands, excess = draw_errors(run).axes
    size = np.hypot(run.modes["real_1_s"], 2 * np.pi * run.modes["frequency_hz"])
    error = run.modes["error_estimate"] / size
    largest = [error[run.modes["approach"] == a].max() for a in run.approaches]
    assert [line.get_ydata().max() for line in bands.lines[::2]] == largest
    assert [line.get_xdata()[-1] for line in excess.lines] == largest
    assert all(line.get_ydata()[0] == 1.0 for line in excess.lines)


def test_directories_without_results_are_named(tmp_path):
    with pytest.raises(SceneError, match="no such run directory"):
        make_figures(read_run(tmp_path / "nowhere"))
    with pytest.raises(SceneError, match="contains no result"):
        make_figures(read_run(tmp_path))
    (tmp_path / "laws.npz").write_bytes(b"not a zip")
    with pytest.raises(SceneError, match=r"laws\.npz"):
        make_figures(read_run(tmp_path))


def test_a_broken_summary_is_named(tmp_path):
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(SceneError, match=r"summary\.json"):
        read_run(tmp_path)
    (tmp_path / "summary.json").write_text("[1]")
    with pytest.raises(SceneError, match="list"):
        read_run(tmp_path)


def branches_of(directory, events, threshold):
    """Drawn damping curves, marks and legend of one branch at the values 0, 0.2, ... 0.8."""
    x = np.linspace(0.0, 0.8, 5)
    rows = [["joint", None, v, n, 0, 2e3, 0.0, 0.0, 1.0, "stable"] for n, v in enumerate(x)]
    write_rows(directory / "sweep.csv", ("approach", "sample", "value", *SWEEP), rows)
    write_rows(directory / "lock_in.csv", ("approach", "sample", *EVENTS), [
        ["joint", None, kind, at, 1e-4, 2.1e3, 0.0, 0, other, 3] for kind, at, other in events
    ])  # fmt: skip
    write_rows(directory / "modes.csv", MODES, [["joint", 0, 0, *[1.0] * 6, "stable", 0]])
    summary = {"in_effect": {"stability": {"threshold": threshold}}}
    run = replace(read_run(directory), summary=summary)
    axis = draw_branches(run).axes[1]
    (line,) = (line for line in axis.lines if len(line.get_xdata()) > 2)
    marks = [tuple(c.get_offsets()[0]) for c in axis.collections if len(c.get_offsets()) == 1]
    legend = axis.get_legend()
    return line.get_xydata(), marks, [t.get_text() for t in legend.get_texts()] if legend else []


def test_a_window_of_squeal_between_two_values_is_drawn_and_named(tmp_path):
    """All computed values are stable; the events alone tell of the window."""
    events = [("merging", 0.622, 1), ("onset of squeal", 0.623, None),
              ("end of squeal", 0.631, None), ("splitting", 0.632, 1)]  # fmt: skip
    curve, marks, texts = branches_of(tmp_path, events, 0.01)
    assert texts == ["2.100 kHz from 0.623 to 0.631"]
    assert marks == [(0.623, -0.01), (0.631, -0.01)]
    new = [[0.622, 0.0], [0.623, -0.01], [0.631, -0.01], [0.632, 0.0]]
    assert np.allclose(curve, [[0, 0], [0.2, 0], [0.4, 0], [0.6, 0], *new, [0.8, 0]])


@pytest.mark.parametrize(
    ("events", "said"),
    [
        ([("onset of squeal", 0.4413, None)], "2.100 kHz from 0.441"),
        ([("onset of squeal", 0.81487, None), ("end of squeal", 0.8151, None)],
         "2.100 kHz from 0.81487 to 0.8151"),
        ([("squeals from the first value", 0.0, None), ("end of squeal", 0.1, None),
          ("onset of squeal", 0.5, None)], "2.100 kHz from 0 to 0.1, from 0.5"),
        ([("end of squeal", 0.3, None)], "2.100 kHz to 0.3"),
        ([(kind, x, None) for x in (0.1, 0.3, 0.5, 0.7)
          for kind, x in (("onset of squeal", x), ("end of squeal", x + 0.1))],
         "2.100 kHz from 0.1 to 0.2, from 0.3 to 0.4, from 0.5 to 0.6 and 1 more"),
    ],
)  # fmt: skip
def test_windows_of_squeal_have_digits_that_tell_them_apart(tmp_path, events, said):
    assert branches_of(tmp_path, events, 0.0)[2] == [said]


def test_branches_without_events_are_drawn_without_marks(tmp_path):
    curve, marks, texts = branches_of(tmp_path, [], 0.0)
    assert len(curve) == 5 and not marks and not texts
