"""Long benchmarks in parts: what is done stays done, and several processes share what is left.

A part is a file of JSON in a folder. Whoever works on one holds a lock, which the system takes back
when the process ends in whatever way; the next one that comes then does that part again.
"""

from __future__ import annotations

import fcntl
import json
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

Part = Mapping[str, Any]


def done_parts(
    folder: Path, names: Sequence[str], work: Callable[[str], Part] | None
) -> dict[str, Part]:
    """Does the parts that are not done and that nobody else works on; returns all that are done.

    Args:
        folder: Where parts are kept; one that exists is gone on with.
        names: Of all parts.
        work: Does the part of a name; None: what is not done stays so.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if work is not None:
        for name in names:
            _do(folder, name, work)
    paths = {name: folder / f"{name}.json" for name in names}
    return {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name, path in paths.items()
        if path.exists()
    }


def _do(folder: Path, name: str, work: Callable[[str], Part]) -> None:
    """Does a part, unless it is done or somebody else does it."""
    path = folder / f"{name}.json"
    with _alone(folder / f"{name}.lock") as alone:
        if alone and not path.exists():
            _write(path, {"commit": commit(), **work(name)})


def commit() -> str:
    """Returns what this runs on."""
    words = ("git", "describe", "--always", "--dirty")
    here = Path(__file__).parent
    return subprocess.run(
        words, check=True, capture_output=True, text=True, cwd=here
    ).stdout.strip()


def commits(parts: Mapping[str, Part]) -> str:
    """Returns what parts ran on."""
    return ", ".join(sorted({part["commit"] for part in parts.values()})) or "none"


@contextmanager
def _alone(path: Path) -> Iterator[bool]:
    """Yields whether nobody else holds a lock; it is held until the end."""
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def _write(path: Path, part: Part) -> None:
    """Writes a part at once or not at all."""
    aside = path.with_suffix(".new")
    aside.write_text(json.dumps(part), encoding="utf-8")
    aside.replace(path)


def print_or_write(text: str, page: Path | None) -> None:
    """Prints a result, or writes it to a page where one is named."""
    if page is None:
        print(text)
    else:
        page.write_text(text, encoding="utf-8")
