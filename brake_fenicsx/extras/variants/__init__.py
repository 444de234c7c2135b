"""A scene against changed scenes: two runs, countermeasures, settings of the computation."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.variants"
EXTRA = Extra(
    name="variants",
    commands=tuple(f"{_HERE}.commands:{w}" for w in ("budget", "countermeasures", "compare")),
    sections={"countermeasures": f"{_HERE}.countermeasure_keys:Countermeasures"},
    check=f"{_HERE}.countermeasure_keys:with_ends",
)
