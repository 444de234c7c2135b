"""The registry: what extras of this program, and packages of others, add to it.

The core imports no extra. An extra is a record ``Extra``: those of this program lie in the modules
of ``brake_fenicsx.extras``, as ``EXTRA``; those of others are entry points of installed packages,
in the group ``brake_fenicsx.extras``. Names in a record are "module:attribute"; each is imported
when it is used.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger

if TYPE_CHECKING:
    import numpy as np
    import scipy.sparse as sp
    from numpy.typing import ArrayLike, NDArray

    from brake_fenicsx.micro.law import Law

    Array = NDArray[np.float64]

GROUP, OWN = "brake_fenicsx.extras", "brake_fenicsx.extensions"
# Endings of mesh files of which init writes a first scene.
DECKS = ".inp", ".cdb", ".bdf", ".nas", ".fem"
MESHES = ".msh", ".med", ".vtu", ".vtk", ".exo", ".e", ".mesh", ".cgns", ".mdpa", ".xdmf"
MESH_FILES = frozenset({*DECKS, *MESHES})
# What the extras of this program answer to, for who has the core alone.
OURS = {
    "decks": (".inp", ".cdb", ".bdf", ".nas", ".fem", "init", "matrices"),
    "dynamometer": ("states", "threshold"),
    "limit_cycle": ("limit_cycle",),
    "measured": ("correlate", "identify", "export"),
    "variants": ("countermeasures", "budget", "compare"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Extra:
    """What an extra adds to the program. A scene that has a section of an extra names it.

    Attributes:
        name: of the extra.
        sections: key of a scene -> type of its section, a dataclass or a tuple of them. Results
            depend on the files that its keys name with ``key(file=True)``, and not on its keys
            with ``key(aside=True)``, which are read after the samples.
        check: ``check(scene, changed)``, the scene with its sections checked and complete;
            ``changed("key=value")`` reads the scene without them after a replacement. In
            ``scene.spanned`` it may name scalars and their values, over which the reduced model
            then reaches.
        commands: of the command line, each a ``Command``.
        readers: ending of a mesh file -> ``read(path)``, and how: "as an Abaqus deck".
        unread: ``unread(path, file, faces, groups)``, what such a file holds beside its mesh.
        bodies: ``bodies(scene, mesh, elastic)``, the bodies with those given by matrices.
        nodes: ``nodes(scene)``, names of the sets of nodes of these.
        samples: what is computed beside the modes of each sample -> ``work(scene, models)``, an
            object with the method ``of(sample, equilibrium, modes, partner, reduced)``, which gives
            arrays to store; the reduced model serves it.
        of_squeal: whether it depends on ``stability.threshold``, beyond which modes squeal.
        band: kept modes of the reduced model reach this multiple of the band for it.
        arrays: how names of these arrays begin.
        stage: ``stage(run, study)``, after the results; collective; it gives a ``RowTable`` by
            stem on the first process.
        tables: stems of its tables, which ``RunData.extras`` holds.
        make_tables: ``tables(stored)``, a ``RowTable`` by stem, from the stored samples.
        figures: name of a figure -> ``draw(run)``, and its caption.
        page: key and title of a section of the page, and ``blocks(run)`` that it begins with.
        cards: fact beside a picture of a mode -> ``text(run, approach, family)``.
    """

    name: str
    sections: Mapping[str, str] = field(default_factory=dict)
    check: str = ""
    commands: tuple[str, ...] = ()
    readers: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    unread: str = ""
    bodies: str = ""
    nodes: str = ""
    samples: Mapping[str, str] = field(default_factory=dict)
    of_squeal: bool = False
    band: float = 0.0
    arrays: tuple[str, ...] = ()
    stage: str = ""
    tables: tuple[str, ...] = ()
    make_tables: str = ""
    figures: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    page: tuple[str, str, str] = ("", "", "")
    cards: Mapping[str, str] = field(default_factory=dict)


@cache
def extras() -> tuple[Extra, ...]:
    """All extras there are: of this program, then of other packages, each by name."""
    found = list[Extra]()
    folder: Iterable[str] = ()
    with suppress(ModuleNotFoundError):  # the core may stand alone
        folder = import_module(GROUP).__path__
    for module in sorted(iter_modules(folder), key=lambda module: module.name):
        found.append(import_module(f"{GROUP}.{module.name}").EXTRA)
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            found.append(point.load())
        except Exception as error:
            logger.warning("extra %s left out: %s: %s", point.name, point.value, error)
    return tuple(found)


def load(name: str) -> Any:
    """The object of a name "module:attribute"."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


def named(scene: Any) -> list[Extra]:
    """Extras that a scene names."""
    return [e for e in extras() if any(getattr(scene, key, None) for key in e.sections)]


def sections(scene: Any) -> list[Any]:
    """Sections of extras that a scene has."""
    return [s for e in named(scene) for key in e.sections if (s := getattr(scene, key))]


def beside_samples(scene: Any) -> dict[str, str]:
    """What extras compute beside the modes of each sample of a scene -> the work."""
    return {what: name for e in named(scene) for what, name in e.samples.items()}


def widest_band(scene: Any) -> float:
    """Multiple of the band that kept modes reach for extras; 0 if none asks for it."""
    return max((extra.band for extra in named(scene)), default=0.0)


def shown(run: Any) -> list[Extra]:
    """Extras that have tables among the results of a run, or none of their own."""
    return [e for e in extras() if not e.tables or not run.extras.keys().isdisjoint(e.tables)]


def absent(word: str) -> str:
    """What to install for a key, a command or the ending of a file; empty if it is there."""
    there = {extra.name for extra in extras()}
    for name, words in OURS.items():
        if word in words and name not in there:
            return f"belongs to the extra {name}; pip install 'brake_fenicsx[{name}]'"
    return ""


def provided(kind: str, where: str, word: str) -> Any:
    """What the one extra does that registers it: ``bodies`` or ``nodes``.

    Args:
        kind: attribute of ``Extra``.
        where: key of the scene that needs it.
        word: by which that extra is known.

    Raises:
        SceneError: the extra is not there.
    """
    for extra in extras():
        if name := getattr(extra, kind):
            return load(name)
    raise SceneError(f"{where}: {absent(word)}")


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

    def matrix(self, brake: Any) -> sp.csr_matrix:
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
    """Own objects for a scene, of ``prepare`` or of the section [extensions].

    Attributes:
        contact: name of an interface -> its contact law (``brake_fenicsx.micro.Law``).
        friction: name of a sliding interface -> its friction law.
        damping: damping terms of the bodies, beside those that the scene names.
        random: dotted key of a random input -> its law, as in ``[samples.random]``.
        figures: name of a figure of the report -> ``draw(run)``.
        marks: what the section says, and version and source of each of its classes.
    """

    contact: Mapping[str, Law] = field(default_factory=dict)
    friction: Mapping[str, FrictionLaw] = field(default_factory=dict)
    damping: Sequence[DampingTerm] = ()
    random: Mapping[str, InputLaw] = field(default_factory=dict)
    figures: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    marks: Mapping[str, Any] = field(default_factory=dict)


def own_class(name: str, folder: Path, allowed: bool) -> tuple[Any, list[str]]:
    """A class or function of a user's own, "module:attribute".

    Entry points of installed packages (group ``brake_fenicsx.extensions``) name what any scene may
    use. A scene is never code: a module beside it is run only where the user allows it.

    Args:
        name: the name.
        folder: of the scene.
        allowed: whether code in the folder may run.

    Returns:
        It, and what results depend on: version of the package, hash of the module.

    Raises:
        ValueError: it is not there, not allowed, or cannot be imported.
    """
    module, _, attribute = name.partition(":")
    points = [point for point in entry_points(group=OWN) if point.value == name]
    path = folder / f"{module}.py"
    there = module.isidentifier() and path.is_file()
    if not points and there and not allowed:
        raise ValueError(
            f"{path} is code beside the scene; read it, and give --allow-extensions to run it"
        )
    if not points and not there:
        raise ValueError(
            f"no installed package has it among its entry points {OWN}, and there is no module"
            f' {path}; write "module:attribute"'
        )
    try:
        if points:
            version = points[0].dist.version if points[0].dist else ""
            found = points[0].load()
            path = Path(sys.modules[module].__file__ or "")
        else:
            version, found = "", getattr(_beside(path), attribute)
    except Exception as error:
        raise ValueError(f"cannot be imported: {type(error).__name__}: {error}") from None
    return found, [version, sha256(path.read_bytes()).hexdigest()]


def _beside(path: Path) -> ModuleType:
    """A module by its file, once for each content of it."""
    name = f"{path.stem}_{sha256(path.read_bytes()).hexdigest()[:12]}"
    if name not in sys.modules:
        spec = spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ImportError(str(path))
        sys.modules[name] = module = module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]
