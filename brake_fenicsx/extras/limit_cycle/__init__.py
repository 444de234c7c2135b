"""Limit cycles: the amplitude at which the growth of a squealing mode ends."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.limit_cycle"
EXTRA = Extra(
    name="limit_cycle",
    sections={"limit_cycle": f"{_HERE}.keys:LimitCycle"},
    check=f"{_HERE}.keys:check",
    samples={"limit cycles": f"{_HERE}.cycles:Cycles"},
    of_squeal=True,
    # They meet higher harmonics: on the block of the tutorials amplitudes are off by 29 % with 1.8,
    # 7 % with 2.5, 0.7 % with 3 and 0.1 % with 4.
    band=3.0,
    arrays=("cycle_", "branch_"),
    tables=("limit_cycle", "limit_cycle_growth", "limit_cycle_families"),
    make_tables=f"{_HERE}.loudness:cycle_tables",
    figures={
        "limit_cycle_growth": (
            f"{_HERE}.loudness:draw_growth",
            "Growth rate of the loudest families over the amplitude of their vibration, one line"
            " for each sample. Growth ends where it is zero (filled circles); from an open circle"
            " on, a vibration grows that dies out when it is smaller.",
        ),
        "limit_cycle_loudness": (
            f"{_HERE}.loudness:draw_loudness",
            "Estimated sound level of the loudest families over the samples: median, quartiles, and"
            " 5 % to 95 % of the samples.",
        ),
    },
    page=("loudness", "How loud", f"{_HERE}.loudness:cycle_blocks"),
    cards={"how growth ends": f"{_HERE}.loudness:loudness_text"},
)
