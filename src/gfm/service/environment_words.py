"""What an environment is made of, in words that two processes can compare.

Files are told by their contents: what they are called, and where they lie, is each machine's own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from gfm.envs.registry import EnvironmentSettings, episode_steps
from gfm.policies import forces_path
from gfm.service.config import differing
from gfm.service.model_files import effects_path

_DIGITS = 16
_LONGEST = 80


def environment_words(name: str, settings: EnvironmentSettings) -> dict[str, str]:
    """Returns every setting of an environment by its path, in words.

    In the place of files stands a digest of their contents, in their order; what they name in turn
    (meshes, included files) is not looked at. The number of threads is left out.

    Args:
        name: The environment's registered name.
        settings: What it is told.

    Raises:
        OSError: a file that is there cannot be read.
    """
    told = msgspec.to_builtins(settings)
    del told["nthread"]
    told["horizon"] = episode_steps(name, settings)
    told["models"] = {
        str(kind): _contents(_model_files(path)) for kind, path in settings.models.items()
    }
    told["recordings"] = _contents(map(Path, settings.recordings))
    told["control"]["ensemble"] = _contents(map(forces_path, settings.control.ensemble))
    told["control"]["ranges"] = _contents(map(Path, filter(None, [settings.control.ranges])))
    return dict(_flat(told))


def difference(theirs: Mapping[str, str], ours: Mapping[str, str]) -> str:
    """Returns in which settings two environments differ, with both values; empty where in none."""
    return ", ".join(
        f"{name:.{_LONGEST}} {there!s:.{_LONGEST}}, not {here!s:.{_LONGEST}}"
        for name, there, here in differing(theirs, ours)
    )


def _model_files(path: str) -> Iterator[Path]:
    yield Path(path)
    if (beside := effects_path(Path(path))).is_file():
        yield beside


def _contents(paths: Iterable[Path]) -> str:
    """Returns a digest of files in their order; of one that is none, of its name."""
    digests = [
        hashlib.sha256(path.read_bytes() if path.is_file() else str(path).encode()).digest()
        for path in paths
    ]
    return hashlib.sha256(b"".join(digests)).hexdigest()[:_DIGITS] if digests else ""


def _flat(told: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in told.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", str(value)
