"""Own objects in place of keys of a scene: friction laws, damping terms, laws of random inputs.

The classes here are protocols: any object with these methods will do, and those that the scene's
own keys make have them too. ``prepare`` takes the objects; nothing of them is stored, so that they
act in the models of one Python process alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import Damping
from brake_fenicsx.scene.scalars import check_scalar

if TYPE_CHECKING:
    import scipy.sparse as sp

    from brake_fenicsx.build.brake import Brake

Array = NDArray[np.float64]


class FrictionLaw(Protocol):
    """Friction of an interface that depends on the sliding speed."""

    def coefficient(self, V: Array) -> tuple[Array, Array]:
        """Friction at some speeds.

        Args:
            V: sliding speeds [m/s], shape (elements,).

        Returns:
            mu [-] and mu'(V) [s/m], which the term ``slope`` of the damping takes, each of shape
            (elements,).
        """


class DampingTerm(Protocol):
    """Damping of the bodies, the same in all samples."""

    def matrix(self, brake: Brake) -> sp.csr_matrix:
        """Damping matrix [N s/m], in the dofs of ``brake.M`` and ``brake.K``."""


class InputLaw(Protocol):
    """Distribution of a random input."""

    def quantile(self, u: ArrayLike, nominal: float) -> Array:
        """Values of the input, SI.

        Args:
            u: probabilities in [0, 1], any shape.
            nominal: value of the input in the scene, SI.
        """


@dataclass(frozen=True, slots=True)
class Extensions:
    """Own objects for a scene.

    Attributes:
        friction: name of a sliding interface -> its friction law.
        damping: damping terms of the bodies, beside those that the scene names.
        random: dotted key of a random input -> its law, as in ``[samples.random]``.
    """

    friction: Mapping[str, FrictionLaw] = field(default_factory=dict)
    damping: Sequence[DampingTerm] = ()
    random: Mapping[str, InputLaw] = field(default_factory=dict)

    def applied(self, scene: Scene) -> Scene:
        """The scene with these objects.

        Raises:
            SceneError: there is no such interface or key, or no section for it.
        """
        given: list[tuple[object, str]] = [(law, "coefficient") for law in self.friction.values()]
        given += [(term, "matrix") for term in self.damping]
        given += [(law, "quantile") for law in self.random.values()]
        for one, method in given:
            if not callable(getattr(one, method, None)):
                raise SceneError(
                    f"{scene.file}: extensions: an object of the type {type(one).__name__} has no"
                    f" method {method!r}; see brake_fenicsx.extensions"
                )
        contact: dict[str, Any] = dict(scene.contact)
        for name, law in self.friction.items():
            if name not in contact:
                raise SceneError(
                    f"{scene.file}: extensions: there is no interface {name!r}; there are"
                    f" {', '.join(contact)}"
                )
            contact[name] = replace(contact[name], friction=law)
        stability = scene.stability
        if self.damping:
            if stability is None:
                raise SceneError(f"{scene.file}: extensions: damping needs the section [stability]")
            table = stability.damping or Damping()
            stability = replace(stability, damping=replace(table, own=tuple(self.damping)))
        random: dict[str, Any] = {**scene.samples.random, **self.random}
        samples = replace(scene.samples, random=random)
        changed = replace(scene, contact=contact, stability=stability, samples=samples)
        for name in self.random:
            check_scalar(changed, f"{scene.file}: extensions: {name}", name)
        return changed
