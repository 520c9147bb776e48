"""Models as MJCF text: written so that it can be read anywhere, and with what changed marked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from pathlib import Path

import mujoco

from gfm.sim.drive_names import name_as_found

_ELEMENT = re.compile(r'<(\w+)(?:.*? name="([^"]*)")?')


def written(spec: mujoco.MjSpec) -> str:
    """Returns a model as MJCF, drives called as they were found; changes `spec` to that end."""
    _make_findable(spec)
    name_as_found(spec)
    spec.compile()
    return str(spec.to_xml())


def _make_findable(spec: mujoco.MjSpec) -> None:
    """Lets `spec` find its meshes and pictures from any folder."""
    folder = Path(spec.modelfiledir).resolve()
    if spec.meshes or spec.hfields or spec.skins:
        spec.meshdir = str(folder / spec.meshdir)
    if spec.textures:
        spec.texturedir = str(folder / spec.texturedir)


def annotated(before: str, after: str) -> str:
    """Returns `after` with a comment at every line that is not in `before`.

    Args:
        before: As MuJoCo writes MJCF: one element on a line.
        after: The same.
    """
    old, new = before.splitlines(), after.splitlines()
    lines: list[str] = []
    for kind, a, b, c, d in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        lines += new[c:d] if kind == "equal" else _changed(old[a:b], new[c:d])
    return "\n".join(lines) + "\n"


def _changed(old: Sequence[str], new: Sequence[str]) -> Iterator[str]:
    """Yields the new lines, each below the old one of the same element, and what is gone.

    Lines that are added one after the other have one comment.
    """
    before = {key: line for line in old if (key := _element(line)) is not None}
    adding = False
    for line in new:
        key = _element(line)
        was = None if key is None else before.pop(key, None)
        if was is not None:
            yield _comment(line, f"nominal: {was.strip()}")
        elif key is not None and not adding:
            yield _comment(line, "added")
        adding = was is None and (adding or key is not None)
        yield line
    for line in before.values():
        yield _comment(line, f"taken out: {line.strip()}")


def _element(line: str) -> tuple[str, str] | None:
    """Returns kind and name of the element that begins on a line; None where none does."""
    found = _ELEMENT.match(line.strip())
    return None if found is None else (found[1], found[2] or "")


def _comment(beside: str, words: str) -> str:
    indent = beside[: len(beside) - len(beside.lstrip())]
    return f"{indent}<!-- {words.replace('--', '- -')} -->"
