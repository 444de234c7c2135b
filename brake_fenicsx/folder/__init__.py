"""The results folder of a run, and the processes that work in it."""
