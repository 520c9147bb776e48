"""Files that appear whole or not at all, and never in the place of another."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gfm.core import BadInputError


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Gives where to write a file that gets its name once it is whole.

    Raises:
        BadInputError: the name is taken, or the disk does not take the file.
    """
    check_free(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    fresh = not path.parent.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise _refused(path, exc) from exc
    try:
        yield part
        with part.open("rb") as written:
            os.fsync(written.fileno())
        give_name(part, path)
    except FileExistsError as exc:
        raise _taken(path) from exc
    except OSError as exc:
        raise _refused(path, exc) from exc
    finally:
        part.unlink(missing_ok=True)
        if fresh:
            with suppress(OSError):  # the file is in it, or others are
                path.parent.rmdir()


def give_name(part: Path, path: Path) -> None:
    """Gives a file the name that it is to have.

    Raises:
        FileExistsError: the name is taken.
    """
    try:
        # Unlike a rename this fails where somebody took the name meanwhile.
        path.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:  # a file system without links, as on a memory stick
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        part.rename(path)
    else:
        part.unlink()


def check_free(path: Path) -> None:
    """Raises BadInputError where a name is taken."""
    if path.exists():
        raise _taken(path)


def _taken(path: Path) -> BadInputError:
    return BadInputError(f"{path}: exists; expected a new name, for nothing is overwritten")


def _refused(path: Path, error: OSError) -> BadInputError:
    return BadInputError(f"{path}: {error.strerror or error}; expected a file to write")
