"""Dynamometer: states of a brake, how often each squeals, and beside it the stops that squealed."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.dynamometer"
EXTRA = Extra(
    name="dynamometer",
    sections={"states": f"{_HERE}.keys:States"},
    check=f"{_HERE}.keys:check",
    samples={"states of the brake": f"{_HERE}.state_modes:StateModes"},
    arrays=("state_",),
    stage=f"{_HERE}.occurrence:compute",
    tables=("states", "states_families", "states_occurrence", "states_events", "states_scores"),
    figures={
        "states": (
            f"{_HERE}.page:draw_matrix",
            "Share of the samples that squeal in each state, over temperature and pressure, for"
            " each speed and direction; in brackets, where stops were measured, the share of them"
            " that squealed.",
        )
    },
    page=("states", "States of the brake", f"{_HERE}.page:blocks"),
    commands=(f"{_HERE}.commands:threshold",),
)
