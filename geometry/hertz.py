"""Profiles of the Hertz references: a round body and the flat base below it, finest at the contact.

The plane of the profile has x across the contact and y away from the base.
"""

from __future__ import annotations

from typing import Any


def round_profile(occ: Any, radius: float, contact: float) -> tuple[int, dict[str, int]]:
    """Lower right quarter of a disc that touches the origin from above.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        radius: radius of the disc [m].
        contact: half-width of the part of the arc that is named [m].

    Returns:
        The surface, and the curves ``contact``, ``free``, ``top`` and ``axis``.
    """
    if not 0 < contact < radius / 2:
        raise ValueError(f"contact {contact} m must lie between 0 and half the radius {radius} m")
    rise = radius - (radius**2 - contact**2) ** 0.5
    low, edge, side, centre = (
        occ.addPoint(x, y, 0) for x, y in ((0, 0), (contact, rise), (radius, radius), (0, radius))
    )
    curves = {
        "contact": occ.addCircleArc(low, centre, edge),
        "free": occ.addCircleArc(edge, centre, side),
        "top": occ.addLine(side, centre),
        "axis": occ.addLine(centre, low),
    }
    return occ.addPlaneSurface([occ.addCurveLoop(list(curves.values()))]), curves


def flat_profile(
    occ: Any, width: float, depth: float, contact: float
) -> tuple[int, dict[str, int]]:
    """Rectangle below the x axis, from the plane of symmetry x = 0.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        width: extent along x [m].
        depth: extent along y [m].
        contact: half-width of the part of the upper edge that is named [m].

    Returns:
        The surface, and the curves ``contact``, ``free``, ``far``, ``bottom`` and ``axis``.
    """
    if not 0 < contact < width:
        raise ValueError(f"contact {contact} m must lie between 0 and the width {width} m")
    at = [occ.addPoint(x, y, 0) for x, y in (
        (0, 0), (contact, 0), (width, 0), (width, -depth), (0, -depth)
    )]  # fmt: skip
    names = ("contact", "free", "far", "bottom", "axis")
    curves = {n: occ.addLine(at[i], at[(i + 1) % 5]) for i, n in enumerate(names)}
    return occ.addPlaneSurface([occ.addCurveLoop(list(curves.values()))]), curves


def away_from_line(contact: float) -> str:
    """Distance from the strip of half-width ``contact`` at the origin, in the profile's plane."""
    beyond = f"(0.5*(abs(x)-{contact!r}+abs(abs(x)-{contact!r})))"
    return f"sqrt({beyond}*{beyond}+y*y)"


def away_from_spot(contact: float) -> str:
    """Distance from the circle of radius ``contact`` about the z axis at z = 0."""
    r = f"(sqrt(x*x+y*y)-{contact!r})"
    beyond = f"(0.5*({r}+abs({r})))"
    return f"sqrt({beyond}*{beyond}+z*z)"
