"""Dynamometer: states of a brake, how often each squeals, and beside it the stops that squealed."""

from typing import Any

from brake_fenicsx.commands import ALLOW, DIRECTORY, argument, command
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.dynamometer"
_MATRIX = "Samples that squeal in each state [%]; in brackets the stops that did, where measured."
_ROC = "Stops with squeal and quiet ones whose predicted share exceeds a limit, for all limits."
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
    commands=(f"{_HERE}:threshold",),
)

SAID = "{approach}: {threshold:.4g} (95 %: {threshold_low:.4g} to {threshold_high:.4g}) {note}"
HELP = "put it into this scene as stability.threshold"


@command(DIRECTORY, argument("--write", metavar="SCENE.toml", help=HELP), ALLOW, alone=True)
def threshold(options: Any, comm: Any) -> str:
    """Print the threshold of damping that fits the measured stops of [states] best."""
    import pandas as pd

    from brake_fenicsx.results.run import read_run
    from brake_fenicsx.scene import read_scene
    from brake_fenicsx.scene.read import with_values, write_text

    known = read_run(options.directory).extras.get("states_scores", {"threshold": []})
    rows = pd.DataFrame(known).dropna(subset="threshold").to_dict("records")
    if not rows:
        remedy = "name states.events, some stops with squeal and some without"
        raise SceneError(f"{options.directory}: tells no threshold; {remedy}")
    if options.write:
        scene, best = read_scene(options.write, options.set or ()), rows[-1]["threshold"]
        write_text(scene.file, with_values(scene, {("stability", "threshold"): best}))
    return "\n".join(SAID.format(**row).rstrip() for row in rows)
