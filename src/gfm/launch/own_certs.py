"""Certificates that a system on one machine makes for itself: nobody has to think of them.

Whoever can read the folder can be anybody in the runs that speak by it, so that it is its owner's
alone.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from gfm.core import BadInputError
from gfm.core.extras import needs
from gfm.launch.spec import ProcessSpec, SystemSpec, free_endpoint

OWN_CERTS = Path("runs/certs")
"""Those of `gfm up` and `gfm router`, and where commands that join a run look for some."""

_FOLDER = "certs"
_DAYS = 365
_PRIVATE = 0o700


def own_certificates(folder: Path) -> None:
    """Makes certificates of every role, or keeps those that are there.

    They appear at once and whole: two that are started together share them.

    Args:
        folder: Theirs; made with mode 0700.

    Raises:
        ConfigError: the package that makes certificates is not installed.
        BadInputError: the folder cannot be made, is not this user's alone, or holds certificates
            that cannot be used (any more).
    """
    if not folder.exists():
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            _make(folder)
        except OSError as exc:
            problem = f"{exc.filename}: {exc.strerror}; expected a folder to write"
            raise BadInputError(problem) from exc
    check_private(folder)
    _complete(folder)


def _make(folder: Path) -> None:
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as above:
        fresh = Path(above) / folder.name
        fresh.mkdir(mode=_PRIVATE)
        _complete(fresh)
        try:
            fresh.rename(folder)
        except OSError:
            if not folder.is_dir():  # else another process was first
                raise


def _complete(folder: Path) -> None:
    """Makes what is missing, and checks what is there."""
    with needs("certificates need", "cryptography", "certs"):
        from gfm.launch.certs import make_certificates
    list(make_certificates(folder, (), _DAYS, datetime.now(UTC)))


def check_private(folder: Path) -> None:
    """Refuses a folder of certificates that others could have written, or can read.

    Raises:
        BadInputError: it is somebody else's, or open to others.
    """
    found = folder.stat()
    mode = found.st_mode & 0o777
    if found.st_uid != os.getuid() or mode & ~_PRIVATE:
        raise BadInputError(
            f"{folder}: has mode {mode:o} and owner {found.st_uid}, expected {_PRIVATE:o} and "
            f"{os.getuid()}: whoever reads it can be anybody; remove it to have it made anew"
        )


def certs_to_join(endpoint: str, certs: str) -> str:
    """Returns the folder of certificates by which to join a run; empty for none.

    Args:
        endpoint: Its router; empty means this machine's.
        certs: The folder that was named. Where none was, it is OWN_CERTS, if there is such a folder
            and no endpoint is named that goes without.

    Raises:
        BadInputError: OWN_CERTS is not this user's alone.
    """
    if certs or endpoint.startswith("tcp/") or not OWN_CERTS.is_dir():
        return certs
    check_private(OWN_CERTS)
    return str(OWN_CERTS)


def own_system(run: str, folder: Path, processes: Iterable[ProcessSpec]) -> SystemSpec:
    """Returns a system at a free port of this machine, with certificates of its own.

    Args:
        run: The run's name.
        folder: Of the run; its certificates lie in `certs` there, made where there are none.
        processes: Of the system.

    Raises:
        ConfigError, BadInputError: as `own_certificates` does.
    """
    certs = folder / _FOLDER
    own_certificates(certs)
    return SystemSpec(
        run=run,
        endpoint=free_endpoint(secure=True),
        processes=tuple(processes),
        certs=str(certs),
    )
