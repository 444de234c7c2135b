"""A scene against changed scenes: two runs, countermeasures, settings of the computation."""
