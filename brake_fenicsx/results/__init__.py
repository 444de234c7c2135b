"""What was computed, counted: the only place that counts squeal."""
