"""Volumes and areas of a mesh as DOLFINx integrates them."""

import ufl
from dolfinx import fem

from brake_fenicsx import compat


def measures(mesh):
    """Cells and volume of each layer, facets and area of each face."""
    found = {}
    for dim, names, tags in ((3, mesh.layers, mesh.cell_tags), (2, mesh.faces, mesh.facet_tags)):
        for name, tag in names.items():
            entities = tags.find(tag)
            one = compat.meshtags(mesh.domain, dim, entities, 1)
            kind = "dx" if dim == 3 else "ds"
            rule = {"quadrature_degree": 6}
            dx = ufl.Measure(kind, domain=mesh.domain, subdomain_data=one, metadata=rule)(1)
            value = fem.assemble_scalar(fem.form(fem.Constant(mesh.domain, 1.0) * dx))
            found[name] = (len(entities), value)
    return found
