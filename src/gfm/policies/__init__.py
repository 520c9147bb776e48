"""Policies that come with gfm: trained on the nominal cell, see docs/results/policies.md."""

from __future__ import annotations

from pathlib import Path

from gfm.core import UnknownNameError

_FOLDER = Path(__file__).parent


def shipped_policy(task: str) -> Path:
    """Returns the file of the policy that was trained for a task, such as `position_matching`.

    Raises:
        UnknownNameError: none comes with gfm; lists those that do.
    """
    path = _FOLDER / f"{task}.npz"
    if not path.is_file():
        raise UnknownNameError("policy", task, [file.stem for file in _FOLDER.glob("*.npz")])
    return path
