"""Modes of one part of a scene against those of a modal test."""

from brake_fenicsx.extensions import Extra

EXTRA = Extra(name="measured")
