"""Modes of one part of a scene against those of a modal test."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.measured"
EXTRA = Extra(
    name="measured",
    commands=tuple(f"{_HERE}.commands:{w}" for w in ("correlate", "identify", "export")),
)
