"""Many samples: their random inputs, their runs over processes, their tables."""
