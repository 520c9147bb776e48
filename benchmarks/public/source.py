"""Files of a repository at a commit, checked by their hashes, and what a set is."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gfm.core import Trajectory

#: An effect on a joint.
Place = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Repository:
    """Where recordings are published.

    Attributes:
        name: OWNER/NAME at github.com.
        commit: In full.
        licence: By its SPDX name; "none" where none was found: nothing of it may be passed on.
    """

    name: str
    commit: str
    licence: str


@dataclass(frozen=True, kw_only=True)
class Clones:
    """Clones of repositories on this machine.

    Attributes:
        folder: Each repository is a clone (bare or not) at OWNER/NAME in it.
    """

    folder: Path

    def read(self, repository: Repository, path: str, sha256: str) -> bytes:
        """Returns a file's bytes as they are at the commit.

        Raises:
            SystemExit: the clone, the commit or the file is not there, or has another hash.
        """
        clone = self.folder / repository.name
        if not clone.exists():
            url = f"https://github.com/{repository.name}"
            raise SystemExit(f"{clone}: no such clone; expected one (git clone {url} {clone})")
        shown = subprocess.run(
            ["git", "-C", str(clone), "show", f"{repository.commit}:{path}"],
            capture_output=True,
            check=False,
        )
        if shown.returncode:
            raise SystemExit(f"{clone}: {shown.stderr.decode().strip()}; expected {path}")
        found = hashlib.sha256(shown.stdout).hexdigest()
        if found != sha256:
            raise SystemExit(f"{clone}: {path} has sha256 {found}; expected {sha256}")
        return shown.stdout


#: Returns a file of the set, by its path in the repository.
Reader = Callable[[str], bytes]


@dataclass(frozen=True, kw_only=True)
class PublicSet:
    """Recordings of one robot, and what is known of it.

    Attributes:
        name: A word.
        robot: What it is, in words.
        repository: Where it is from.
        files: SHA-256 of every file that is read, by its path.
        recordings: Makes the recordings of the files.
        model: Makes the nominal model, MJCF.
        held_out: Names of the recordings that errors are measured on.
        known: Effects, each with its joint, that the publishers identified. Not a truth: what they
            fitted to recordings of this robot.
        allowed: Effects that are neither right nor wrong, for they may well be there.
        note: What a reader should know.
    """

    name: str
    robot: str
    repository: Repository
    files: Mapping[str, str]
    recordings: Callable[[Reader], Sequence[Trajectory]]
    model: Callable[[Reader], str]
    held_out: tuple[str, ...]
    known: frozenset[Place]
    allowed: frozenset[Place] = field(default=frozenset())
    note: str = ""

    def reader(self, clones: Clones) -> Reader:
        """Returns what reads the set's files, and no others."""
        return lambda path: clones.read(self.repository, path, self.files[path])
