"""Gmsh builders, one per part or small scene: ``build(occ, parameters) -> PartEntities``.

A builder adds its volumes to the current gmsh model and names them and their faces. Builders see
plain numbers in metres; units and defaults live in the dataclass beside each builder.
"""
