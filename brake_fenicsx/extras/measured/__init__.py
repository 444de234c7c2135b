"""Modes of one part of a scene against those of a modal test."""
