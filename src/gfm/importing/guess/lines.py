"""Lines of a mapping, each with its reason."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of TOML, and why it says that; an empty text is a remark alone."""

    text: str
    why: str = ""

    def __str__(self) -> str:
        remark = f"# {self.why}" if self.why else ""
        return f"{self.text}  {remark}".rstrip() if self.text else remark


def quoted(text: str) -> str:
    """Returns a string as TOML writes it."""
    return json.dumps(text, ensure_ascii=False)


def column_text(name: str, index: int | None, scale: float = 1.0, offset: float = 0.0) -> str:
    """Returns a column as a mapping writes it, as short as it can be."""
    parts = [f"column = {quoted(name)}"]
    parts += [] if index is None else [f"index = {index}"]
    parts += [] if scale == 1.0 else [f"scale = {scale!r}"]
    parts += [] if offset == 0.0 else [f"offset = {offset!r}"]
    return quoted(name) if len(parts) == 1 else f"{{ {', '.join(parts)} }}"


def toml(lines: Sequence[Line]) -> str:
    """Returns the text of a mapping."""
    return "".join(f"{line}\n" for line in lines)
