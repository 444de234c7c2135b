"""Stiffness by layers: of several at once it is the sum of each."""

import numpy as np

from brake_fenicsx.geometry import disc, pad
from brake_fenicsx.macro.elasticity import affine_parts, assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh


def test_several_layers_in_one_matrix(comm):
    """A pattern of the first layer alone loses entries of the others, without a word."""
    parts = {
        "disc": (disc, disc.Disc(size=30e-3)),
        "pad": (pad, pad.Pad(size=18e-3, plate_size=18e-3)),
    }
    mesh = build_mesh(parts, comm)
    stiff = {name: isotropic((1 + i) * 1e11, 0.3) for i, name in enumerate(mesh.layers)}
    materials = {name: Material(C, 7800.0) for name, C in stiff.items()}
    elastic = assemble_elastic(mesh, materials, {})
    assert {"disc.body", "pad.lining", "pad.plate"} <= set(stiff)
    backwards = dict(reversed(stiff.items()))
    rest = {name: C for name, C in stiff.items() if name != "pad.plate"}
    groups = [stiff, backwards, rest, {"pad.plate": stiff["pad.plate"]}]
    found = affine_parts(mesh, elastic.free, groups)
    K = elastic.K
    most = np.abs(K.data).max()
    for other in (found[0], found[1], found[2] + found[3]):
        assert abs(other - K).max() < 1e-12 * most
