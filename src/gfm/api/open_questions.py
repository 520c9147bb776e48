"""What a diagnosis left open: effects that other motions would decide."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gfm.core import BadInputError
from gfm.excitation.blind_spots import ANY

#: Below this confidence, a named effect is an open question.
_SURE = 0.9
#: After these verdicts, only suspects are open that alone would explain so much.
_DECIDED, _CLOSE = ("no_gap", "explained"), 0.9


def open_questions(document: Mapping[str, Any], where: str) -> list[str]:
    """Returns the effects that a diagnosis could not decide, by name; none for all.

    Args:
        document: As report.json has it.
        where: What messages call it.

    Raises:
        BadInputError: it lacks what `gfm diagnose` writes.
    """
    try:
        decided = document["verdict"] in _DECIDED
        suspects = [
            one["effect"]
            for one in document["suspects"]
            if one["decided_by"] and (not decided or one["gain"] >= _CLOSE)
        ]
        unsure = [one["effect"] for one in document["effects"] if _is_unsure(one)]
        unseen = [one["effect"] for one in document.get("blind_spots", ())]
    except (KeyError, TypeError, AttributeError) as exc:
        raise BadInputError(
            f"report {where}: {exc!r}; expected verdict, effects and suspects as "
            "`gfm diagnose` writes them"
        ) from exc
    # Of a joint that stood still, everything is open: all motions.
    return [] if ANY in unseen else [*suspects, *unsure, *unseen]


def read_report(path: Path) -> Mapping[str, Any]:
    """Returns a diagnosis's document, also out of a run's.

    Raises:
        BadInputError: no such file, or it is none.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise BadInputError(f"report {path}: no such file") from exc
    except (ValueError, OSError) as exc:
        raise BadInputError(f"report {path}: {exc}; expected JSON") from exc
    found = document.get("diagnosis", document) if isinstance(document, dict) else None
    schema = found.get("schema") if isinstance(found, dict) else None
    if not isinstance(found, dict) or schema != "gfm.diagnosis/1":
        raise BadInputError(f"report {path}: schema {schema!r}, expected 'gfm.diagnosis/1'")
    return found


def _is_unsure(effect: Mapping[str, Any]) -> bool:
    withheld = any(one["ci95"] is None for one in effect["parameters"].values())
    return withheld or (effect["confidence"] or 0.0) < _SURE
