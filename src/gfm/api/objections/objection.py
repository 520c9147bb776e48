"""Why a recording cannot be used."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Objection:
    """Why a recording cannot be used: what was found in it, where, and what to do."""

    where: str
    problem: str
    expected: str
