"""What a guess knows beforehand: the model, and what its user said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gfm.core import CommandKind


@dataclass(frozen=True, kw_only=True)
class Robot:
    """What a model says of its joints.

    Attributes:
        joints: Those that are driven, in the order of their drives.
        command_kind: What the drives take.
        ranges: Lowest and highest position of joints that have limits, rad (m where it slides).
        slides: Joints that slide.
    """

    joints: tuple[str, ...]
    command_kind: CommandKind
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    slides: frozenset[str] = frozenset()


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user said where a guess had to ask.

    Attributes:
        use: Topics, or beginnings of columns' names, to take where several fit; or words in them.
        unit: Of positions (`Unit`), or None.
    """

    use: tuple[str, ...] = ()
    unit: str | None = None
