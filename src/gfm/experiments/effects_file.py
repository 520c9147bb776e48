"""Effects in a file: what a diagnosis wrote, ready to be put into a model again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gfm.core import BadInputError
from gfm.effects import EffectInstance
from gfm.effects.registry import find_effect

#: Files that list effects: beside a corrected model, and reports.
SCHEMAS = ("gfm.effects/1", "gfm.diagnosis/1")


def read_effects(path: Path) -> tuple[EffectInstance, ...]:
    """Returns the effects that a `corrected.effects.json` or a diagnosis's `report.json` lists.

    Raises:
        BadInputError: the file is missing, or does not list effects as expected.
        UnknownNameError: an effect is not known here.
    """
    if not path.is_file():
        raise BadInputError(f"effects {path}: no such file")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as exc:
        raise BadInputError(f"effects {path}: {exc}; expected JSON") from exc
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema not in SCHEMAS:
        raise BadInputError(
            f"effects {path}: schema {schema!r}, expected one of {', '.join(SCHEMAS)}"
        )
    return tuple(_instance(entry, f"effects {path}") for entry in document.get("effects", ()))


def _instance(entry: Mapping[str, Any], where: str) -> EffectInstance:
    try:
        effect = find_effect(entry["effect"])
        joints = tuple(str(name) for name in entry["joints"])
        amounts = {name: float(p["value"]) for name, p in entry["parameters"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as exc:
        raise BadInputError(
            f"{where}: {exc!r} in {json.dumps(entry)[:80]}; expected effect, joints and parameters "
            "with a value each"
        ) from exc
    wanted = {p.name for p in effect.parameters}
    if set(amounts) != wanted:
        raise BadInputError(
            f"{where}: {effect.name} with {', '.join(sorted(amounts))}; "
            f"expected {', '.join(sorted(wanted))}"
        )
    if not effect.admissible(amounts):
        raise BadInputError(f"{where}: {effect.name} {amounts}: out of bounds")
    return EffectInstance(effect=effect, joints=joints, values=amounts)
