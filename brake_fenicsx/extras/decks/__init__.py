"""Decks of other programs: first scenes, readers of mesh files, bodies by matrices."""
