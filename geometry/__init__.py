"""Gmsh builders, one per part or small scene."""
