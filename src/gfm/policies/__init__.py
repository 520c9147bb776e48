"""Policies and learned forces that come with gfm: how they were made is in docs/results."""

from __future__ import annotations

from pathlib import Path

from gfm.core import UnknownNameError

_FOLDER = Path(__file__).parent
#: Experiment in which a policy goes on learning; on what, a file says that has it as its base.
TRAINING_ON = _FOLDER / "training_on.toml"
#: Settings of the robot on which a run closes the loop on a task.
ROBOT = _FOLDER / "robot.toml"


def shipped_policy(task: str) -> Path:
    """Returns the file of the policy that was trained for a task, such as `position_matching`.

    Raises:
        UnknownNameError: none comes with gfm; lists those that do.
    """
    path = _FOLDER / f"{task}.npz"
    if not path.is_file():
        raise UnknownNameError("policy", task, [file.stem for file in _FOLDER.glob("*.npz")])
    return path


def forces_path(given: str) -> Path:
    """Returns the file of a force model: one at that path, or one of that name from gfm."""
    path, shipped = Path(given), _FOLDER / "forces" / f"{given}.npz"
    return shipped if shipped.is_file() and not path.exists() else path
