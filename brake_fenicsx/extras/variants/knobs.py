"""Knobs of a scene: settings of the computation that a user cannot measure, and their variants.

A resolution has two refinements of one ratio, so that an order of convergence can be observed; a
choice has other readings of the same physics. A knob that a scene does not use says why.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from brake_fenicsx.checks import MIN_PIXELS
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.stability_section import NEWTON
from brake_fenicsx.scene.surface_section import MAX_PIXELS

RESOLUTION, CHOICE = "resolution", "choice"
MESH, FINER = 1.25, 2.0
PIXELS = 2.0**0.5


@dataclass(frozen=True, slots=True)
class Variant:
    """The scene with one knob turned.

    Attributes:
        overrides: "key=value" replacements in the scene.
        says: what is changed, for a person.
        dofs: number of free dofs relative to the scene's, estimated.
        elements: number of contact elements, likewise.
    """

    overrides: tuple[str, ...]
    says: str
    dofs: float = 1.0
    elements: float = 1.0


@dataclass(frozen=True, slots=True)
class Knob:
    """One setting of the computation.

    Attributes:
        name: short name, as in names of folders.
        says: what it is, in plain words.
        kind: RESOLUTION or CHOICE.
        paired: whether the samples of its variants are the scene's own, number by number, where
            the laws keep their number of points.
        variants: the runs; the n-th one of a resolution is ``ratio**n`` times finer.
        ratio: of two refinements [-]; 1 for a choice.
        reason: why there are no variants.
        perfect: whether it concerns the classical approach alone.
    """

    name: str
    says: str
    kind: str
    paired: bool
    variants: tuple[Variant, ...] = ()
    ratio: float = 1.0
    reason: str = ""
    perfect: bool = False


def knobs(scene: Scene, pixels: int | None) -> list[Knob]:
    """All knobs, those that the scene does not use too.

    Args:
        scene: the scene.
        pixels: points along a side of its laws' patches; None where it has no laws.
    """
    return [*_laws(scene, pixels), *_surface(scene), *_meshes(scene), *_solution(scene)]


def _laws(scene: Scene, pixels: int | None) -> list[Knob]:
    """Resolution and physics of the pressure-gap laws."""
    micro = scene.micro if "micro" in scene.stages else None
    names = (
        ("pixels", "the resolution of the laws", RESOLUTION, False, PIXELS),
        ("laws", "the number of laws", RESOLUTION, False, FINER),
        ("steps", "the load steps of a law", RESOLUTION, True, FINER),
        ("contact-tolerance", "the tolerance of a contact solution", CHOICE, True, 1.0),
        ("hardness", "the hardness of the lining", CHOICE, True, 1.0),
        ("boundary", "the boundary of a patch", CHOICE, True, 1.0),
    )
    if micro is None or pixels is None:
        return [Knob(*row[:4], reason="the scene has no laws of a rough surface") for row in names]
    other = "periodic" if micro.boundary == "free" else "free"
    fine = [round(pixels * PIXELS**n) for n in (1, 2)]
    hard = micro.hardness or 0.0
    # Variants, and why there may be none.
    found = (
        ([_one("micro.pixels", str(n), f"{n} x {n} points") for n in fine
          if MIN_PIXELS <= n <= MAX_PIXELS],
         f"finer laws would have more than {MAX_PIXELS} points along a side"),
        ([_one("micro.laws", str(n * micro.laws), f"{n * micro.laws} laws") for n in (2, 4)], ""),
        ([_one("micro.steps", str(n * micro.steps), f"{n * micro.steps} steps") for n in (2, 4)],
         ""),
        ([_one("micro.tolerance", f"{micro.tolerance / 100!r}", "a hundredth")], ""),
        ([_one("micro.hardness", f'"{factor * hard / 1e6!r} MPa"', f"{text} as hard")
          for factor, text in ((2.0, "twice"), (0.5, "half")) if hard],
         "the scene is elastic, and no hardness can be guessed: name micro.hardness"),
        ([_one("micro.boundary", f'"{other}"', other)], ""),
    )  # fmt: skip
    return [
        Knob(*row[:4], tuple(variants), row[4], "" if variants else why)
        for row, (variants, why) in zip(names, found, strict=True)
    ]


# Readings of the surface: name, what it is, key, values, whether samples stay the same.
SURFACE = (
    ("long-waves", "the spectrum below the scan's lowest wave number", "low", ("flat", "extend"),
     True),
    ("variance", "the variance of the artificial surfaces", "S_q", ("spectrum", "scan"), True),
    ("heights", "the shape of the height distribution", "distribution", ("johnson", "normal"),
     False),
    ("spectrum", "the spectrum of the artificial surfaces", "spectrum", ("fit", "measured"), True),
    ("level", "what is subtracted from the scan", "level", ("plane", "second-order"), True),
)  # fmt: skip


def _surface(scene: Scene) -> list[Knob]:
    """Readings of the surface, and what the critical gaps do."""
    surface = scene.surface if "surface" in scene.stages else None
    gaps = {name: c.gap for name, c in scene.contact.items()}
    rough = surface is not None and ("micro" in scene.stages or set(gaps.values()) != {"none"})
    measured = surface is not None and bool(surface.scan)
    found = []
    for name, says, key, values, paired in SURFACE:
        now = getattr(surface, key, None)
        if key == "distribution" and now is None and not measured:
            now = "johnson"
        why = ""
        if not rough:
            why = "the scene has no rough surface"
        elif key in ("level", "spectrum") and not measured:
            why = "the scene has no scan"
        elif key == "S_q" and "waviness" in gaps.values():
            why = "critical gaps of waviness share the variance of the spectrum"
        other = next(v for v in values if v != now)
        variants = () if why else (_one(f"surface.{key}", f'"{other}"', other),)
        found.append(Knob(name, says, CHOICE, paired, variants, reason=why))
    wavy = tuple(n for n, gap in gaps.items() if gap != "none")
    off = Variant(tuple(f'{dotted("contact", n, "gap")}="none"' for n in wavy), "none")
    found += [
        Knob("gap", "the critical gaps", CHOICE, True, (off,) if wavy else (),
             reason="" if wavy else "no interface has critical gaps"),
    ]  # fmt: skip
    return found


def _meshes(scene: Scene) -> list[Knob]:
    """Mesh of the contact faces and of the bodies; only what a builder makes can be refined."""
    pads = {table.faces[0].split(".")[0] for table in scene.contact.values()}
    face: dict[str, float] = {}
    body: dict[str, float] = {}
    for name, part in scene.parts.items():
        sizes = {k: getattr(part.parameters, k, None) for k in ("size", "plate_size")}
        kept = {k: v for k, v in sizes.items() if v is not None}
        for key, value in kept.items():
            group = face if name in pads and key == "size" else body
            group[dotted("parts", name, key)] = value
    groups = (
        ("face-mesh", "the mesh of the contact face and its patches", face, (0.5, 2.0)),
        ("body-mesh", "the mesh of the bodies", body, (2.0, 0.0)),
    )
    return [
        Knob(name, says, RESOLUTION, name == "body-mesh", tuple(
            Variant(
                tuple(f'{k}="{1e3 * v / MESH**n:.6g} mm"' for k, v in sizes.items()),
                f"cells {MESH**n:.4g} times smaller",
                MESH ** (n * power[0]), MESH ** (n * power[1]),
            ) for n in (1, 2)
        ) if sizes else (), MESH, "" if sizes else "no such mesh is made by a builder")
        for name, says, sizes, power in groups
    ]  # fmt: skip


def _solution(scene: Scene) -> list[Knob]:
    """Accuracy of equilibrium and modes, and perfect contact."""
    table, stability = scene.samples, scene.stability
    classical = "classical" in table.approaches
    stiff = table.classical.penalty
    reduced = stability is not None and stability.method == "reduced"
    fine: tuple[Variant, ...] = ()
    wide: tuple[Variant, ...] = ()
    if stability is not None and reduced:
        fine = (_one("stability.tolerance", repr(stability.tolerance / 100), "a hundredth"),)
        top = 1.4 * (stability.cutoff or 1.8 * stability.band[1])
        wide = (_one("stability.cutoff", f'"{top:.8g} Hz"', "1.4 times as high"),)
    full = "" if reduced else "every sample is solved at full order"
    # Two rough samples beside it, so that its modes come from the reduced model of the scene.
    rough = [name for name in ("multi-scale", "classical") if name in table.approaches]
    lean = (f"samples.approaches={json.dumps(rough)}", "samples.n=2", 'samples.design="random"')
    penalty = tuple(
        Variant((f'samples.classical.penalty="{factor * stiff!r} Pa/m"', *lean), text)
        for factor, text in ((10.0, "ten times as stiff"), (0.1, "a tenth as stiff"))
    ) if classical else ()  # fmt: skip
    why = "" if classical else "the scene has no approach 'classical'"
    strict = scene.equilibrium.tolerance / 100
    least = strict >= NEWTON[0]
    newton = (_one("equilibrium.tolerance", repr(strict), "a hundredth"),) if least else ()
    return [
        Knob("reduction", "the tolerance of the reduced model", CHOICE, True, fine, reason=full),
        Knob("cutoff", "the real modes kept of the bodies", CHOICE, True, wide, reason=full),
        Knob("penalty", "the penalty of perfect contact", CHOICE, True, penalty, 1.0, why, True),
        Knob("newton", "the tolerance of Newton's iterations", CHOICE, True, newton,
             reason="" if least else "a hundredth is less than round-off"),
    ]  # fmt: skip


def _one(key: str, value: str, says: str) -> Variant:
    return Variant((f"{key}={value}",), says)
