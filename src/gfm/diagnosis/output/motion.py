"""A recording beside what the nominal and the corrected model make of it.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Joint positions of the robot and of open-loop rollouts under the commands that it got.

    Attributes:
        recording: Its name.
        kind: Of its commands.
        joints: Names.
        time_s: From the beginning of what is told, increasing, shape (T,).
        measured: rad (m where a joint slides), shape (T, J).
        nominal: By the model as it was given, likewise.
        corrected: By the model with the named effects, likewise.
        anew_s: After which a rollout begins anew as measured; infinity where it is one.
    """

    recording: str
    kind: CommandKind
    joints: tuple[str, ...]
    time_s: Array
    measured: Array
    nominal: Array
    corrected: Array
    anew_s: float

    def stretch(self, length_s: float) -> Motion:
        """Returns the part of about so long, s, in which the nominal model is furthest off."""
        steps = max(int(np.searchsorted(self.time_s, length_s)), 1)
        squares = np.sum((self.nominal - self.measured) ** 2, axis=1)
        running = np.concatenate([[0.0], np.cumsum(squares)])
        start = int(np.argmax(running[steps:] - running[:-steps])) if len(squares) > steps else 0
        here = slice(start, start + steps)
        return replace(
            self,
            time_s=self.time_s[here] - self.time_s[start],
            measured=self.measured[here],
            nominal=self.nominal[here],
            corrected=self.corrected[here],
        )
