"""Folders that commands write to."""

from __future__ import annotations

from pathlib import Path

from gfm.core import BadInputError


def check_folder(out: Path) -> None:
    """Raises BadInputError where a file is in the way of a folder to write to."""
    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not there.is_dir():
        raise BadInputError(f"{there}: is a file; expected a folder to write to")


def check_new_folder(out: Path) -> None:
    """Raises BadInputError where a folder to write to cannot be made, or holds something."""
    check_folder(out)
    if out.exists() and any(out.iterdir()):
        raise BadInputError(f"{out}: exists; expected a new or an empty folder")
