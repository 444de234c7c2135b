"""The command threshold."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from brake_fenicsx.commands import DIRECTORY, argument, command
from brake_fenicsx.errors import SceneError

LINE = re.compile(r"(^\[stability\].*\n(?:(?!\[).*\n)*?threshold\s*=\s*)[^\s#]+", re.M)
SAID = "{approach}: {threshold:.4g} (95 %: {threshold_low:.4g} to {threshold_high:.4g})"
HELP = "put it into this scene, in its line stability.threshold"
WRITE = argument("--write", metavar="SCENE.toml", complete="file", help=HELP)


@command(DIRECTORY, WRITE, alone=True)
def threshold(options: Any, comm: Any) -> str:
    """Print the threshold of damping that fits the measured stops of [states] best."""
    import pandas as pd

    from brake_fenicsx.folder.files import whole_file
    from brake_fenicsx.results.run import read_run

    known = read_run(options.directory).extras.get("states_scores", {"threshold": []})
    rows = pd.DataFrame(known).dropna(subset="threshold").to_dict("records")
    if not rows:
        remedy = "name states.events, some stops with squeal and some without"
        raise SceneError(f"{options.directory}: tells no threshold; {remedy}")
    if options.write:
        path, best = Path(options.write), f"{rows[-1]['threshold']:.4g}"
        text, found = LINE.subn(rf"\g<1>{best}", path.read_text("utf-8"))
        if not found:
            raise SceneError(f"{path}: [stability] has no line of threshold; write threshold = 0")
        with whole_file(path) as file:
            file.write_text(text, "utf-8")
    return "\n".join(SAID.format(**row) for row in rows)
