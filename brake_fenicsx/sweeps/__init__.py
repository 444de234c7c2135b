"""Modes over a parameter: followed branches, lock-in, the value at which a family squeals."""
