"""[limit_cycle] of a scene."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import key


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """[limit_cycle]: the amplitude at which a mode stops growing ([page](limit_cycle.md)).

    Attributes:
        harmonics: harmonics of the vibration beside its mean.
        points: points of time over a period, more than twice the harmonics.
        largest: amplitude at which a mode is followed no further, root mean square of the gap's
            first harmonic over the closed patches.
        damping_below: modes whose damping -2 alpha / |omega| lies below this are followed; 0: those
            that grow beyond ``stability.threshold``. Stable modes may grow from a kick.
        radiating: faces whose motion and sound are stated; those of the disc if not given.
    """

    harmonics: int = key(default=5)
    points: int = key(default=32)
    largest: float = key("m", default=20e-6, band=(1e-9, 1e-3))
    damping_below: float = key(default=0.0, sign="zero")
    radiating: tuple[str, ...] = key(default=())

    def contradictions(self) -> Iterator[str]:
        """Points of time tell the harmonics apart."""
        if self.points <= 2 * self.harmonics:
            yield (
                f".points = {self.points}: more than twice limit_cycle.harmonics ="
                f" {self.harmonics} are needed; 6 times as many or more see patches open"
            )

    @property
    def areas(self) -> dict[str, str]:
        """Key of the scene -> face that it names, of which the area counts."""
        return {f"limit_cycle.radiating[{i}]": face for i, face in enumerate(self.radiating)}


def check(scene: Scene, _: Callable[[str], Scene]) -> Scene:
    """Limit cycles are those of the reduced model.

    Raises:
        SceneError: the scene has none.
    """
    if scene.stability is None or scene.stability.method != "reduced":
        raise SceneError('limit_cycle: needs [stability] with method = "reduced"')
    return scene
