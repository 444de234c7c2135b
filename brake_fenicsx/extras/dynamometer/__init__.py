"""Dynamometer: states of a brake, how often each squeals, and beside it the stops that squealed."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.dynamometer"
_MATRIX = (
    "Share of the samples that squeal in each state, of all modes and of the likeliest families; in"
    " brackets, where stops were measured, the share of them that squealed."
)
_ROC = (
    "Shares of the stops with squeal and of the quiet ones whose predicted share exceeds a limit."
)
EXTRA = Extra(
    name="dynamometer",
    sections={"states": f"{_HERE}.states:States"},
    check=f"{_HERE}.states:check",
    samples={"states of the brake": f"{_HERE}.state_modes:StateModes"},
    arrays=("state_",),
    stage=f"{_HERE}.outcomes:compute",
    tables=("states", "states_occurrence", "states_events", "states_scores"),
    figures={
        "states": (f"{_HERE}.page:draw_matrix", _MATRIX),
        "states_roc": (f"{_HERE}.page:draw_roc", _ROC),
    },
    page=("states", "States of the brake", f"{_HERE}.page:blocks"),
    commands=(f"{_HERE}.commands:threshold",),
)
