"""All figures that a run can have: names, captions and what draws them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from brake_fenicsx.extras.limit_cycle.cycle_figures import draw_growth, draw_loudness
from brake_fenicsx.results.run import RunData

from .contact_figures import draw_contact_pressure
from .critical_figures import draw_chart, draw_critical, draw_worst
from .driver_figures import draw_driver_maps, draw_drivers
from .error_figures import draw_errors
from .micro_figures import draw_contact_maps, draw_laws, laws_caption
from .probability_figures import draw_convergence, draw_counts, draw_probability
from .sensitivity_figures import draw_correlations, draw_sensitivity
from .squeal_figures import draw_families, draw_squeal_map
from .surface_figures import draw_bearing_curve, draw_statistics
from .sweep_figures import draw_branches
from .topography_figures import draw_artificial, draw_topography, topography_caption

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure: the name of its files, its caption, and how it is drawn."""

    name: str
    caption: str | Callable[[RunData], str]
    draw: Callable[[RunData], Figure | None]

    def told(self, run: RunData) -> str:
        """The caption of the figure of a run."""
        return self.caption if isinstance(self.caption, str) else self.caption(run)


PLOTS: tuple[Plot, ...] = (
    Plot(
        "figure4_topography",
        topography_caption,
        draw_topography,
    ),
    Plot(
        "figure5_statistics",
        "Height distribution, and radial power spectrum C(q) of the scan with its bi-fractal fit "
        "(2 pi times the integral of q C is the variance). Of several scans, thin lines are the "
        "scans and the thick line is their mean. Below: ratio of measured spectrum "
        "and fit, on a logarithmic scale.",
        draw_statistics,
    ),
    Plot(
        "bearing_curve",
        "Bearing curve (material ratio curve, Abbott curve): share of the surface that lies above "
        "a height. Of several scans, thin lines are the scans and the thick line is all heights "
        "together.",
        draw_bearing_curve,
    ),
    Plot(
        "figure6_artificial",
        "Scan and one artificial surface at the same length and height scale, with the height "
        "distribution and spectrum of the artificial surface. A patch longer than the scan has "
        'longer waves too: with surface.S_q = "spectrum" the artificial spectrum follows the fit '
        'of the measured one, and the variance follows from it; with "scan" the artificial '
        "spectrum lies lower, so that the variance is that of the scan.",
        draw_artificial,
    ),
    Plot(
        "figure7_contact_maps",
        "Real contact of the artificial surface of the first law with a rigid plane at growing mean"
        " pressure p, with the hardness of the laws if they have one; circles mark the few points"
        " of a light contact. E* is the composite modulus.",
        draw_contact_maps,
    ),
    Plot(
        "figure8_laws",
        laws_caption,
        draw_laws,
    ),
    Plot(
        "figure9_squeal_map",
        "Frequency and damping of every complex mode of every sample; the scale is linear between "
        "-0.0001 and 0.0001 and logarithmic beyond. Negative damping is an unstable mode, "
        "grey where it lies above the threshold of squeal. Without damping terms an unstable mode "
        "has a mirror image that decays.",
        draw_squeal_map,
    ),
    Plot(
        "squeal_families",
        "Squeal modes by family (the same mode recognised in many samples), the most severe first: "
        "mean frequency, number of samples in which the family squeals, median damping there; the "
        "same colour marks the same frequency.",
        draw_families,
    ),
    Plot(
        "probability_per_band",
        "Probability that a brake of the population has at least one squeal mode in the band: "
        "share of samples, with 95 % Wilson intervals.",
        draw_probability,
    ),
    Plot(
        "unstable_per_sample",
        "Number of squeal modes per sample: share of samples with each number.",
        draw_counts,
    ),
    Plot(
        "convergence",
        "Convergence with the number of samples: share of samples with a squeal mode, and mean "
        "number of squeal modes, with 95 % intervals.",
        draw_convergence,
    ),
    Plot(
        "input_correlations",
        "Inputs correlated with squeal: Spearman's rank correlation of each random input with the "
        "number of squeal modes of the sample, from -1 to 1, with 95 % intervals.",
        draw_correlations,
    ),
    Plot(
        "sensitivity",
        "Share of the variance of the growth rate (0 where no mode squeals) that each random input "
        "explains alone, with 95 % intervals, in the whole band and in the most severe families; "
        "roughness, where it is one of them, is all that laws and critical gaps do. Diamonds: "
        "total share, with all interactions of the input, also those with the roughness, where "
        "the design provides it. Empty bars: too few samples for an interval. Negative shares are "
        "sampling error of the estimate.",
        draw_sensitivity,
    ),
    Plot(
        "sweep_branches",
        "Modes of the nominal brake of the scene over the parameter: frequency above, damping "
        "below. Dots: two modes merge (lock-in); squares: they split; diamonds: two damped modes "
        "pass next to a merging point. Coloured: branches that squeal, with their frequency at the "
        "onset and the values at which squeal begins and ends (filled and hollow triangles). "
        "Lines are straight between computed points. Dotted: the threshold of squeal.",
        draw_branches,
    ),
    Plot(
        "sweep_critical",
        "Distribution of the critical value: share of the rough samples in which each family "
        "squeals up to a value of the parameter, with 95 % Wilson intervals.",
        draw_critical,
    ),
    Plot(
        "sweep_samples",
        "Range over the samples of the sweep: lowest damping of any mode of a sample, and "
        "number of its squeal modes.",
        draw_worst,
    ),
    Plot(
        "sweep_chart",
        "Stability chart over two parameters: number of squeal modes of the nominal brake, "
        "and its largest negative damping. White line: where squeal begins.",
        draw_chart,
    ),
    Plot(
        "limit_cycle_growth",
        "Growth rate of the loudest families over the amplitude of their vibration, one line for"
        " each sample. Growth ends where it is zero (filled circles); from an open circle on, a"
        " vibration grows that dies out when it is smaller.",
        draw_growth,
    ),
    Plot(
        "limit_cycle_loudness",
        "Estimated sound level of the loudest families over the samples: median, quartiles, and"
        " 5 % to 95 % of the samples.",
        draw_loudness,
    ),
    Plot(
        "drivers",
        "What drives the most severe families: change of the growth rate alpha [1/s] to first "
        "order by a friction coefficient larger by 0.01, a loss factor larger by 0.001, and "
        "pressures, stiffnesses and masses larger by 1 %. Of more than two approaches: the first "
        "and the last, which has the most random inputs. Bars: first sample of the approach; "
        "hollow bars are not reliable, because the mode nearly merges with another one. Diamonds: "
        "median over the samples where the family squeals. Above: mean frequency of the family, "
        "and alpha, the median where there is one.",
        draw_drivers,
    ),
    Plot(
        "driver_maps",
        "Most unstable mode of the first sample of each approach, over the contact elements: "
        "derivative of the growth rate with respect to the logarithm of the contact "
        "stiffness (red: a stiffer element raises the growth rate), and work of friction over a "
        "period relative to the energy of the mode (red: friction feeds energy in). Both per area; "
        "the scales end at 98 %.",
        draw_driver_maps,
    ),
    Plot(
        "contact_pressure",
        "Contact pressure [MPa] at equilibrium, first sample of each approach, seen "
        "along the disc axis from one side. Empty patches are open elements; the mean refers to "
        "the whole face. The colour scale ends at the 98 % quantile of closed elements.",
        draw_contact_pressure,
    ),
    Plot(
        "eigenvalue_errors",
        "Error estimates of the eigenvalues relative to |lambda|, by the solver or the reduced "
        "model.",
        draw_errors,
    ),
)
