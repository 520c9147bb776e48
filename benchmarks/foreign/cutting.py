"""Where recordings are taken from, and how much of each."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gfm.core import Trajectory


@dataclass(frozen=True, kw_only=True)
class Sources:
    """The recordings that foreign files are made of.

    Attributes:
        data: Folder with `measured` and `simulated`.
        longest_s: How much of each recording is taken, from its beginning.
        most: How many recordings are taken of each robot.
    """

    data: Path
    longest_s: float = field(default=float("inf"))
    most: int | None = None

    def some(self, paths: Sequence[Path]) -> list[Path]:
        """Returns as many of the files as are taken.

        Raises:
            SystemExit: there are none.
        """
        if not paths:
            raise SystemExit(f"{self.data}: no recordings of this robot there")
        return list(paths)[: self.most]

    def rows(self, path: Path) -> list[str]:
        """Returns the lines of a packed table, its head first, as far as `longest_s` goes.

        The first column is the time in s.
        """
        head, *rows = gzip.decompress(path.read_bytes()).decode().splitlines()
        return [head, *(row for row in rows if float(row.partition(",")[0]) <= self.longest_s)]

    def rows_of(self, recording: Trajectory) -> int:
        """Returns how many of its measurements are taken."""
        return int(np.sum(recording.time_s - recording.time_s[0] <= self.longest_s))
