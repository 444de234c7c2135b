"""Eigensolvers, counts and checks that full order and the reduced model share."""
