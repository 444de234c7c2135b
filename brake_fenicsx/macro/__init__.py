"""macro."""
