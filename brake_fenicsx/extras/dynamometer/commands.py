"""The command threshold."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from brake_fenicsx.commands import DIRECTORY, argument, command
from brake_fenicsx.errors import SceneError


@command(
    DIRECTORY,
    argument("--write", metavar="SCENE.toml", complete="file",
             help="put it into this scene, in its line stability.threshold"),
    alone=True,
)  # fmt: skip
def threshold(options: Any, comm: Any) -> str:
    """Print the threshold of damping that fits the measured stops of [states] best."""
    import numpy as np

    from brake_fenicsx.folder.files import whole_file
    from brake_fenicsx.results.run import read_run

    scores = read_run(options.directory).extras.get("states_scores", {"threshold": np.zeros(0)})
    told = np.flatnonzero(np.isfinite(scores["threshold"].astype(float)))
    if not told.size:
        raise SceneError(
            f"{options.directory}: tells no threshold; it takes states.events, with stops that"
            " squealed and stops that did not"
        )
    names = ("approach", "threshold", "threshold_low", "threshold_high")
    rows = [[scores[name][i] for name in names] for i in told]
    if options.write:
        path = Path(options.write)
        line = re.compile(r"(^\[stability\][^\[]*?^threshold\s*=\s*)[^\s#]+", re.M)
        text, found = line.subn(rf"\g<1>{rows[-1][1]:.4g}", path.read_text("utf-8"))
        if not found:
            raise SceneError(f"{path}: [stability] has no line of threshold; write threshold = 0")
        with whole_file(path) as file:
            file.write_text(text, "utf-8")
    return "\n".join("{}: {:.4g} (95 %: {:.4g} to {:.4g})".format(*row) for row in rows)
