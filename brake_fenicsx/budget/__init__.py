"""The error budget of a scene: what each knob of the computation does to its answer."""
