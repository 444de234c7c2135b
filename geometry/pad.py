"""Brake pad: lining, back plate with ears, optional shims, stacked from the friction face."""

from typing import Any

import numpy as np

from . import pad_shape, part
from .pad_shape import Pad


def layers(pad: Pad) -> list[tuple[str, float]]:
    """Names and thicknesses [m] from the friction face: ``lining``, ``plate``, then the shim.

    One layer of shim is ``shim``; several are ``shim1``, ``shim2``, ... from the plate outwards.
    """
    shims = pad.shim if isinstance(pad.shim, tuple) else (pad.shim / pad.shim_layers,)
    if not isinstance(pad.shim, tuple):
        shims = shims * pad.shim_layers if pad.shim > 0 else ()
    elif pad.shim_layers != 1:
        raise ValueError(f"shim_layers = {pad.shim_layers}: the shim already names its layers")
    names = ["shim"] if len(shims) == 1 else [f"shim{i}" for i in range(1, len(shims) + 1)]
    if any(not h > 0 for h in shims):
        raise ValueError(f"shim {list(shims)} m: every layer needs a thickness")
    return [("lining", pad.lining), ("plate", pad.plate), *zip(names, shims, strict=True)]


def thicknesses(pad: Pad) -> dict[str, tuple[str, ...]]:
    """Lengths that are thicknesses of layers: parameter -> layers, which share it in proportion."""
    shims = tuple(name for name, _ in layers(pad)[2:])
    whole = {"shim": shims} if shims and not isinstance(pad.shim, tuple) else {}
    return {"lining": ("lining",), "plate": ("plate",), **whole}


HEIGHTS = ("slot_depth", "chamfer_depth")


def levels(pad: Pad) -> list[float]:
    """Heights of all planes across z [m], rising, which the lengths of ``HEIGHTS`` move.

    Chamfers stay plane as long as no other plane of the lining lies within their depth; none where
    that is not so.
    """
    chamfer = [pad_shape.chamfer_depth(pad)] if pad.chamfer > 0 else []
    slot = [pad.slot_depth] if pad.slot > 0 and pad.slot_depth is not None else []
    depths = [0.0, *chamfer, *slot, *np.cumsum([h for _, h in layers(pad)])]
    if np.any(np.diff(depths) <= 0):
        return []
    sides = {"top": (1,), "bottom": (-1,)}.get(pad.side, (1, -1))
    return sorted(side * (pad.z + depth) for side in sides for depth in depths)


def widths(pad: Pad) -> tuple[str, ...]:
    """Lengths that move nodes at right angles to z."""
    chamfer = ("chamfer",) if pad.chamfer > 0 and pad.chamfer_depth is not None else ()
    return (*chamfer, "slot") if pad.slot > 0 else chamfer


def sideways(pad: Pad, name: str, points: np.ndarray) -> np.ndarray:
    """Movement of points along x and y per length, shape (n, 2).

    The lining between slot and chamfers moves in proportion. Points stay on their cylinders about
    z, to second order in the length.
    """
    x, h = points[:, :2], np.abs(points[:, 2]) - pad.z
    across = np.array([-np.sin(pad.position), np.cos(pad.position)])
    t = x @ across
    if name == "slot":
        deep = pad.lining if pad.slot_depth is None else pad.slot_depth
        end = pad.lining + (pad.plate if deep >= pad.lining else 0.0)
        flat = [0, pad.slot / 2, pad_shape.half(pad, pad.chamfer)], [0, 0.5, 0]
        step = np.sign(t) * np.interp(np.abs(t), *flat) * np.interp(h, [deep, end], [1, 0])
        normal = np.broadcast_to(across, x.shape)
    else:
        side, lines = np.where(t > 0, 1.0, -1.0), pad_shape.ends(pad)
        angle, offset = (np.where(t > 0, lines[1][i], lines[0][i]) for i in (1, 2))
        normal = np.column_stack([-np.sin(angle), np.cos(angle)])
        y = side * (offset - np.sum(normal * x, axis=1))
        step = np.interp(y, [pad.chamfer, pad_shape.half(pad, pad.slot / 2)], [-1, 0])
        step *= side * np.interp(h, [0, pad_shape.chamfer_depth(pad)], [1, 0])
    along = normal
    if pad.shape != "rectangle":
        along = np.column_stack([-x[:, 1], x[:, 0]])
    return along * (step / np.sum(along * normal, axis=1))[:, None]


def cut_faces(occ: Any, pad: Pad) -> dict[str, tuple[float, float]]:
    """Faces that the outline cuts off.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        pad: its parameters.

    Returns:
        Face -> area that is left and area of the whole [m^2], of one pad; empty where the piston's
        circle lies on the pad.
    """
    left, whole = pad_shape.piston_area(occ, pad), np.pi / 4 * pad.piston_diameter**2
    return {"piston": (left, whole)} if left < (1 - 1e-6) * whole else {}


def _size(pad: Pad, layer: str) -> float:
    """Mesh size of a layer [m]."""
    if layer.startswith("shim") and pad.shim_size is not None:
        return pad.shim_size
    return pad.size if layer == "lining" else pad.plate_size


def _sides(pad: Pad) -> tuple[list[float], bool]:
    """Sides to build, and whether the rest is their mirror image."""
    pad_shape.check(pad)
    sides = {"top": [1.0], "bottom": [-1.0], "both": [1.0, -1.0]}.get(pad.side)
    if sides is None:
        raise ValueError(f"side {pad.side!r}: use top, bottom or both")
    mirror = pad.side == "both" and pad.mirror
    return (sides[:1] if mirror else sides), mirror


def build(occ: Any, pad: Pad) -> part.PartEntities:
    """Add one pad, or two mirror images, to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        pad: its parameters.

    Returns:
        Layers ``lining``, ``plate`` and those of the shim, see ``layers``; faces ``friction``,
        ``ears`` (their end faces) and ``piston`` (the part of the circle that lies on the pad).
    """
    sides, mirror = _sides(pad)
    volumes: dict[str, list[int]] = {}
    faces: dict[str, list[int]] = {"friction": [], "ears": [], "piston": []}
    for side in sides:
        found, named = _one_pad(occ, pad, side)
        for name, tags in found.items():
            volumes.setdefault(name, []).extend(tags)
        for name, tags in named.items():
            faces[name].extend(tags)
    sizes = {name: _size(pad, name) for name in volumes}
    return part.PartEntities(
        volumes, {n: tags for n, tags in faces.items() if tags}, sizes, mirror=mirror
    )


def _one_pad(occ: Any, pad: Pad, side: float) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Build one pad on one side of the disc; side = +1 or -1."""
    stack = layers(pad)
    heights = np.cumsum([pad.z] + [thickness for _, thickness in stack])
    solids = [_slab(occ, pad, z, h) for z, (_, h) in zip(heights, stack, strict=False)]
    cut = pad_shape.cutters(occ, pad)
    linings = occ.cut([solids[0]], cut)[0] if cut else solids[:1]
    if pad.ear_length > 0:
        plate = [solids[1], *pad_shape.ears(occ, pad, heights[1], pad.plate)]
        solids[1] = occ.fuse(plate[:1], plate[1:])[0][0]
    # The circle may reach beyond the pad: only what lies on it is imprinted.
    outside = _slab(occ, pad, heights[-2], heights[-1] - heights[-2])
    on_pad, _ = occ.intersect([pad_shape.piston(occ, pad, heights[-1])], [outside])
    solids = [s for s in occ.fragment([*linings, *solids[1:]], on_pad)[0] if s[0] == 3]
    if side < 0:
        occ.mirror(solids, 0, 0, 1, 0)
    occ.synchronize()
    tags = sorted({tag for _, tag in solids})
    volumes: dict[str, list[int]] = {}
    for (name, _), low, high in zip(stack, heights[:-1], heights[1:], strict=True):
        z_low, z_high = sorted((side * low, side * high))
        volumes.setdefault(name, []).extend(part.volumes_between(tags, z_low, z_high))
    return volumes, _faces(occ, pad, tags, side, heights)


def _slab(occ: Any, pad: Pad, z: float, height: float) -> tuple[int, int]:
    """The pad's outline, extruded [m]."""
    solid = occ.extrude([(2, pad_shape.outline(occ, pad, z))], 0, 0, height)
    return next((dim, int(tag)) for dim, tag in solid if dim == 3)


def _faces(
    occ: Any, pad: Pad, tags: list[int], side: float, heights: np.ndarray
) -> dict[str, list[int]]:
    """Name the faces of one built pad."""
    r = pad_shape.middle(pad)
    centre = r * np.array([np.cos(pad.position), np.sin(pad.position)])
    reach = pad.piston_diameter / 2 + 1e-6

    def on_piston(low: np.ndarray, high: np.ndarray) -> bool:
        near = np.all(low[:2] > centre - reach) and np.all(high[:2] < centre + reach)
        return bool(near and part.flat_at(side * heights[-1])(low, high))

    upright = part.faces_where(tags, lambda low, high: bool(high[2] - low[2] > 0.5 * pad.plate))
    return {
        "friction": part.faces_where(tags, part.flat_at(side * pad.z)),
        "ears": _at_tips(occ, pad, 2, upright),
        "piston": part.faces_where(tags, on_piston),
    }


def sweep(occ: Any, pad: Pad) -> part.Swept:
    """Add the pad's footprint to the current gmsh model, with the same names as ``build``.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        pad: its parameters; chamfers are not swept.
    """
    sides, mirror = _sides(pad)
    if pad.chamfer > 0:
        raise ValueError(
            'a chamfered lining is not swept along z: write chamfer = 0, or cells = "tetrahedra"'
        )
    if len(sides) > 1:
        raise ValueError("two pads of hexahedra are mirror images: write mirror = true")
    regions, tips = _footprint(occ, pad)
    body = tuple(name for name in regions if name != "ears")
    open_slot = tuple(name for name in body if "slot" not in name)
    press = tuple(name for name in body if "piston" in name)
    slabs, z = [], pad.z
    for name, h in layers(pad):
        whole = (*body, "ears") if name == "plate" and "ears" in regions else body
        pieces = [(h, whole)]
        if name == "lining" and len(open_slot) < len(body):
            depth = pad.lining if pad.slot_depth is None else pad.slot_depth
            pieces = [(depth, open_slot), (h - depth, body)][: 1 + (depth < h)]
        for height, own in pieces:
            n = part.element_count(height, _size(pad, name))
            slabs.append(part.Slab(name, z, z + height, n, own))
            z += height
    plate = next(i for i, slab in enumerate(slabs) if slab.layer == "plate")
    faces: dict[str, tuple[part.SweptFace, ...]] = {
        "friction": (part.SweptFace(0, "low", slabs[0].regions),)
    }
    if tips:
        faces["ears"] = (part.SweptFace(plate, "side", ("ears",)),)
    faces["piston"] = (part.SweptFace(len(slabs) - 1, "high", press),)
    return part.Swept(
        regions, {"ears": tips} if tips else {}, tuple(slabs), faces, pad.size,
        mirror=mirror, below=sides[0] < 0,
    )  # fmt: skip


def _footprint(occ: Any, pad: Pad) -> tuple[dict[str, list[int]], list[int]]:
    """Regions of the outline in the plane z = 0, and the curves at the ears' ends."""
    body = (2, pad_shape.outline(occ, pad, 0.0))
    tools = {"piston": [pad_shape.piston(occ, pad, 0.0)]}
    if pad.slot > 0:
        tools["slot"] = [pad_shape.slot_face(occ, pad)]
    for name, tool in tools.items():
        tools[name] = occ.intersect(tool, [(2, occ.copy([body])[0][1])])[0]
    ears = pad_shape.ears(occ, pad, 0.0) if pad.ear_length > 0 else []
    flat = [tool for group in tools.values() for tool in group]
    _, pieces = occ.fragment([body], flat + ears)
    inside = {
        name: {e for t in group for e in pieces[1 + flat.index(t)]} for name, group in tools.items()
    }
    occ.synchronize()
    regions: dict[str, list[int]] = {}
    for piece in pieces[0]:
        name = "_".join(n for n in inside if piece in inside[n]) or "rest"
        regions.setdefault(name, []).append(piece[1])
    outer = {e for group in pieces[1 + len(flat) :] for e in group} - set(pieces[0])
    if outer:
        regions["ears"] = sorted(tag for _, tag in outer)
    import gmsh

    curves = [tag for _, tag in gmsh.model.getEntities(1)]
    return regions, _at_tips(occ, pad, 1, curves)


def _at_tips(occ: Any, pad: Pad, dim: int, tags: list[int]) -> list[int]:
    """Those of some curves or faces whose centres are those of the ears' ends."""
    tips = pad_shape.ear_tips(pad) if pad.ear_length > 0 else []
    centre = {tag: occ.getCenterOfMass(dim, tag)[:2] for tag in tags}
    return [tag for tag in tags if any(np.hypot(*(centre[tag] - tip)) < 1e-6 for tip in tips)]
