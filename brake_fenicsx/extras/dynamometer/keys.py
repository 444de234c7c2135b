"""[states] of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import key
from brake_fenicsx.scene.scalars import changes_bodies


@dataclass(frozen=True, slots=True)
class States:
    """[states]: stops of a dynamometer test, each a state of the brake ([page](dynamometer.md)).

    Attributes:
        matrix: CSV file with a state in each line; its heading names pressure, speed, temperature
            (each with its unit in brackets), direction, section, stops.
        grid: values of the same headings, of which every combination is a state.
        loads: loads that have the pressure of the state; those with a pressure if not given.
        tables: CSV files of scalars over pressure, speed or temperature: headings are these, and
            dotted keys of the scene.
        outside: what happens to a state beyond the values of a table: "refuse", or "hold" its
            last value.
        gap: interface -> gap that is imposed on its elements: a formula in metres, or a CSV file
            with the columns x, y and gap.
        bands: ends of the bands of frequency in which stops with squeal are counted.
        events: CSV file of the stops that squealed: state or its numbers, frequency, stop, level.
        tolerance: distance at most between the frequencies of an event and of a family.
    """

    matrix: str | None = key(default=None, file=True)
    grid: dict[str, tuple[str, ...]] = key(default=dict)
    loads: tuple[str, ...] = key(default=())
    tables: tuple[str, ...] = key(default=(), file=True)
    outside: str = key(default="refuse", choices=("refuse", "hold"))
    gap: dict[str, str] = key(default=dict, file=True)
    bands: tuple[float, ...] = key("Hz", default=(1e3, 3e3, 8e3, 16e3), aside=True)
    events: str | None = key(default=None, aside=True)
    tolerance: float = key("Hz", default=150.0, aside=True)

    def contradictions(self) -> Iterator[str]:
        """States are listed or made; bands rise."""
        if bool(self.matrix) == bool(self.grid):
            yield ": write matrix, a file, or grid, a table of values; one of the two"
        if len(self.bands) < 2 or list(self.bands) != sorted(set(self.bands)):
            yield f".bands = {list(self.bands)}: write two or more rising frequencies"


def check(scene: Scene, _: Callable[[str], Scene]) -> Scene:
    """States are of the reduced model, and its box holds what they change in the bodies.

    Raises:
        SceneError: the scene has no modes, or a file and its line say what is no state.
    """
    from .matrix import read_matrix, state_values

    if scene.stability is None or scene.stability.method != "reduced":
        raise SceneError('states: needs [stability] with method = "reduced"')
    matrix, damping = read_matrix(scene), scene.damping
    if "reverse" in {*matrix.direction} and damping and damping.gyroscopic:
        raise SceneError(
            "states: reverse turns the gyroscopic term, which the bodies have for one direction;"
            " leave gyroscopic out of stability.damping, or run the directions one by one"
        )
    values = state_values(scene, matrix)
    ranges = {n: tuple(map(float, x)) for n, x in values.items() if changes_bodies(scene, n)}
    return replace(scene, spanned={**scene.spanned, **ranges})
