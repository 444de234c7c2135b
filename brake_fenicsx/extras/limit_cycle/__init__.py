"""Limit cycles: the amplitude at which the growth of a squealing mode ends."""
