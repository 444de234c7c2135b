"""Round bodies and flat bases of the Hertz references, finest at the contact: parts of a mesh.

Profiles lie in a plane with x across the contact and y away from the base. Each part is a builder
and its parameters, with a layer ``body``; lengths in m.
"""

from types import SimpleNamespace

import numpy as np

from brake_fenicsx.geometry.part import PartEntities, Slab, Swept, SweptFace, faces_where

TINY = 1e-6


def round_profile(occ, radius, contact):
    """Lower right quarter of a disc that touches the origin from above: surface and curves."""
    rise = radius - (radius**2 - contact**2) ** 0.5
    low, edge, side, centre = (
        occ.addPoint(x, y, 0) for x, y in ((0, 0), (contact, rise), (radius, radius), (0, radius))
    )
    curves = {
        "contact": occ.addCircleArc(low, centre, edge),
        "free": occ.addCircleArc(edge, centre, side),
        "top": occ.addLine(side, centre),
        "symmetry_x": occ.addLine(centre, low),
    }
    return occ.addPlaneSurface([occ.addCurveLoop(list(curves.values()))]), curves


def flat_profile(occ, width, depth, contact):
    """Rectangle below the x axis, from the plane of symmetry x = 0: surface and curves."""
    corners = (0, 0), (contact, 0), (width, 0), (width, -depth), (0, -depth)
    at = [occ.addPoint(x, y, 0) for x, y in corners]
    names = ("contact", "free", "far", "bottom", "symmetry_x")
    curves = {n: occ.addLine(at[i], at[(i + 1) % 5]) for i, n in enumerate(names)}
    return occ.addPlaneSurface([occ.addCurveLoop(list(curves.values()))]), curves


def revolved(profile, heights, contact, fine, size):
    """A quarter turn of a profile about z, cut at x = 0 and y = 0.

    Args:
        profile: makes the surface, whose y becomes z.
        heights: face -> lowest and highest point of a face of revolution.
        contact: radius of the face ``contact``, below which others lie at its height.
        fine: mesh size there.
        size: largest mesh size.
    """

    def build(occ, _):
        surface, _ = profile(occ)
        occ.rotate([(2, surface)], 0, 0, 0, 1, 0, 0, np.pi / 2)
        turned = occ.revolve([(2, surface)], 0, 0, 0, 0, 0, 1, np.pi / 2)
        occ.synchronize()
        body = [tag for dim, tag in turned if dim == 3]
        tests = {f"symmetry_{'xy'[c]}": lambda low, high, c=c: high[c] < TINY for c in (0, 1)}
        for name, z in heights.items():
            r = contact + TINY if name == "contact" else np.inf
            tests[name] = lambda low, high, z=z, r=r: (
                np.allclose((low[2], high[2]), z, atol=TINY) and high[0] < r
            )
        faces, taken = {}, set()
        for name, test in tests.items():
            faces[name] = [tag for tag in faces_where(body, test) if tag not in taken]
            taken |= {*faces[name]}
        r = f"(sqrt(x*x+y*y)-{contact!r})"
        away = f"sqrt(0.25*({r}+abs({r}))^2+z*z)"
        return PartEntities({"body": body}, faces, {"body": size}, ((fine, away),), 0.4)

    return SimpleNamespace(build=build), None


def sphere(radius=50e-3, contact=2e-3, fine=0.1e-3, size=10e-3):
    """One eighth of a sphere above z = 0; faces contact, free, top, symmetry_x, symmetry_y."""
    rise = radius - np.sqrt(radius**2 - contact**2)
    heights = {"contact": (0, rise), "free": (rise, radius), "top": (radius, radius)}
    return revolved(lambda occ: round_profile(occ, radius, contact), heights, contact, fine, size)


def base(radius=50e-3, depth=50e-3, contact=2.2e-3, fine=0.12e-3, size=10e-3):
    """A quarter of a cylinder below z = 0; faces as of the sphere, far and bottom for top."""
    heights = {"contact": (0, 0), "free": (0, 0), "far": (-depth, 0), "bottom": (-depth, -depth)}
    profile = lambda occ: flat_profile(occ, radius, depth, contact)  # noqa: E731
    return revolved(profile, heights, contact, fine, size)


def sliced(profile, slice, contact, fine, size=10e-3):
    """A slice of a profile along y, one element thick; faces are its curves, and ``sides``."""

    def sweep(occ, _):
        surface, curves = profile(occ)
        occ.synchronize()
        faces = {name: (SweptFace(0, "side", (name,)),) for name in curves}
        faces["sides"] = (SweptFace(0, "low", ("all",)), SweptFace(0, "high", ("all",)))
        beyond = f"(abs(x)-{contact!r}+abs(abs(x)-{contact!r}))"
        away = f"sqrt(0.25*{beyond}^2+y*y)"
        return Swept(
            {"all": [surface]}, {name: [tag] for name, tag in curves.items()},
            (Slab("body", -slice, 0.0, 1, ("all",)),), faces, size, ((fine, away),), 0.25,
            upright=True,
        )  # fmt: skip

    return SimpleNamespace(sweep=sweep), None


def cylinder(radius=50e-3, slice=0.5e-3, contact=2e-3, fine=0.1e-3):
    """Lower half x > 0 of a cylinder along y, above z = 0."""
    return sliced(lambda occ: round_profile(occ, radius, contact), slice, contact, fine)


def slab(slice=0.5e-3, contact=2.2e-3, fine=0.12e-3, width=50e-3):
    """Half x > 0 of a flat base below z = 0."""
    return sliced(lambda occ: flat_profile(occ, width, width, contact), slice, contact, fine)
