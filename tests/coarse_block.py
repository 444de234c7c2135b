"""The block on a plate with rough contact, on few cells: two families squeal in all samples."""

from pathlib import Path

SCENES = Path(__file__).parents[1] / "scripts" / "scenes"
BLOCK = SCENES / "block_on_plate.toml"
FRICTION, HEIGHT = "contact.block_plate.friction", "parts.block.height"
ROUGH = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '0.05 um' }", "contact.block_plate.gap=hdf",
    "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.05 um' }",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'",
    "stability.band=['0 Hz','30 kHz']", "stability.method=reduced", "stability.threshold=1e-3",
    "samples.n=3",
]  # fmt: skip
# The same on other cells, in rough and in perfect contact, as sweeps follow it.
SWEPT = [
    *ROUGH[:4], "parts.block.size='10 mm'", "parts.plate.size='14 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.method=reduced", "stability.threshold=1e-3",
    "samples.approaches=['multi-scale','classical']", "samples.n=4",
]  # fmt: skip


def levers(*pairs):
    """Countermeasures of a scene as a replacement, from keys and farthest values as TOML."""
    tables = ", ".join(f"{{ key = '{key}', to = {to} }}" for key, to in pairs)
    return f"countermeasures=[{tables}]"
