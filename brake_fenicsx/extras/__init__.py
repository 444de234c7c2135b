"""What a scene or a command must name; the core imports none of it, and finds it by its records."""
