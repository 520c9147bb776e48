"""The file `result.json` of attempts on a robot: whole after each, so that the rest can follow."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import final

import numpy as np

from gfm.core import BadInputError, CommandKind
from gfm.envs import evaluation
from gfm.envs.matching_task import TASKS
from gfm.envs.outcomes import Outcome
from gfm.experiments.attempts import Attempt
from gfm.recording import read_recording
from gfm.report.files import write_texts

RESULT = "result.json"
SCHEMA = "gfm.drive/1"


def recorded_s(attempt: Attempt) -> float:
    """Returns how long an attempt's recording tells what its speeds did, s; 0 for not at all.

    It ends where the bridge holds the arm by positions, and is of these alone where that is so from
    the beginning.

    Raises:
        BadInputError: the recording cannot be read.
    """
    if not attempt.recording:
        return 0.0
    recording = read_recording(Path(attempt.recording))
    return recording.duration_s if recording.command_kind is CommandKind.VELOCITY else 0.0


@final
class Kept:
    """What came of attempts, in a file that is whole after every one of them.

    Args:
        folder: Where it lies.
        about: Settings under which they were made.

    Attributes:
        attempts: So far.

    Raises:
        BadInputError: the folder holds attempts under other settings, or no such file.
    """

    def __init__(self, folder: Path, about: dict[str, object]) -> None:
        self.attempts: list[Attempt] = []
        self._path, self._about = folder / RESULT, about
        if not self._path.exists():
            return
        try:
            told = json.loads(self._path.read_text())
            there, rows = told["about"], told["attempts"]
            self.attempts = [Attempt(**row) for row in rows]
        except (ValueError, KeyError, TypeError) as error:
            raise BadInputError(f"{self._path}: is no result of gfm drive: {error}") from error
        differing = [name for name, value in about.items() if there.get(name) != value]
        if differing:
            name = differing[0]
            raise BadInputError(
                f"{self._path}: made with {name} {there.get(name)}, asked for {about[name]}; "
                "expected the same settings, or another folder"
            )

    @property
    def done(self) -> set[tuple[int, int]]:
        """Goal and trial of each attempt that was made."""
        return {(one.goal, one.trial) for one in self.attempts}

    def add(self, attempt: Attempt) -> None:
        """Keeps one more."""
        self.attempts.append(attempt)
        rows = [asdict(one) for one in self.attempts]
        told = {"schema": SCHEMA, "about": self._about, "attempts": rows}
        write_texts(self._path.parent, {RESULT: json.dumps(told, indent=2) + "\n"})

    def together(self, task: str) -> evaluation.Attempts:
        """Returns all of them, goal after goal, as `gfm evaluate` tells its own; at least one."""
        made = sorted(self.attempts, key=lambda one: (one.goal, one.trial))
        path = np.full((len(made), max(len(one.path) for one in made), 2), np.nan)
        for row, one in zip(path, made, strict=True):
            row[: len(one.path)] = one.path
        goals = sorted({one.goal for one in made})
        return evaluation.Attempts(
            goals=TASKS[task].radial_goals()[goals],
            goal=np.array([goals.index(one.goal) for one in made], np.intp),
            outcome=np.array([Outcome[one.outcome.upper()] for one in made], np.int64),
            steps=np.array([one.steps for one in made], np.int64),
            place=np.array([one.place_m for one in made]),
            turn=np.array([one.turn_rad for one in made]),
            path=path,
        )
