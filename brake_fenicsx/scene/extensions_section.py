"""Keys of [extensions]."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from brake_fenicsx.scene.keys import key

# Names -> "module:attribute", or a table with it under ``use`` beside arguments.
NAMES = {"type": lambda: dict[str, str | dict[str, Any]]}


@dataclass(frozen=True, slots=True)
class ExtensionsTable:
    """[extensions]: classes of installed packages ([developer_guide.md](developer_guide.md)).

    Attributes:
        contact: interface -> contact law, "module:Class" or a table with ``use = "module:Class"``
            and the arguments of the class, in SI units.
        friction: sliding interface -> friction law.
        damping: any name -> damping term of the bodies.
        random: dotted key of a random input -> its law.
        builders: name for ``parts.NAME.builder`` -> dataclass of its parameters.
        figures: name of a figure of the page -> function that draws it.
        allow: code beside the scene may run; for the command line alone, ``--allow-extensions``.
    """

    contact: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    friction: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    damping: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    random: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    builders: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    figures: dict[str, Any] = field(default_factory=dict, metadata=NAMES)
    allow: bool = key(default=False)
