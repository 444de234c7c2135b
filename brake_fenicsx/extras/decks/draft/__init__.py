"""First scenes of mesh files: what a deck says, and proposals for the rest."""
