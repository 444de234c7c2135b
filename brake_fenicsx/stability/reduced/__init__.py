"""One sample in the reduced model: its pencil, its errors, its corrections."""
