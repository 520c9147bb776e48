"""What a file that is to be read holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.importing.guess.lines import Line
from gfm.importing.guess.signals import Signal
from gfm.importing.tables import Table


@dataclass(frozen=True, kw_only=True)
class Found:
    """Tables and signals of one file.

    Attributes:
        head: Lines of format and time.
        tail: Lines of topics.
        states: Table of the measurements.
        commands: Table of the commands.
        signals: Of both.
        lerobot: Written by LeRobot.
    """

    head: Sequence[Line]
    tail: Sequence[Line] = ()
    states: Table
    commands: Table
    signals: Sequence[Signal]
    lerobot: bool = False
