"""Where a result came from."""

from __future__ import annotations

import hashlib
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import gfm


def provenance(
    files: Mapping[str, Sequence[Path]], seed: int, words: Sequence[str]
) -> dict[str, object]:
    """Returns what a result should say about where it came from.

    Args:
        files: What was read, by role.
        seed: Of everything random.
        words: The command line.
    """
    return {
        "files": [
            {"role": role, "path": str(path), "sha256": sha256(path)}
            for role, paths in files.items()
            for path in paths
        ],
        "versions": {
            "gfm": gfm.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in ("mujoco", "numpy", "scipy")},
        },
        "seed": seed,
        "command": shlex.join(words),
    }


def command_line() -> list[str]:
    """Returns the words with which this process was started."""
    return [Path(sys.argv[0]).name, *sys.argv[1:]]


def sha256(path: Path) -> str:
    """Returns the hash of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
