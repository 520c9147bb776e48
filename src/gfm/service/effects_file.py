"""Effects in a file: what a diagnosis wrote, ready to be put into a model again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gfm.core import BadInputError, UnknownNameError
from gfm.effects import Effect, EffectInstance, Scope, find_effect

#: Files that list effects: beside a model, and reports.
BESIDE, REPORT = "gfm.effects/1", "gfm.diagnosis/1"
#: Joints that an effect names; one of the whole robot names those that share it, or none.
_JOINTS = {Scope.JOINT: 1, Scope.LAST: 1, Scope.PAIR: 2}


def read_effects(path: Path) -> tuple[EffectInstance, ...]:
    """Returns the effects that a `corrected.effects.json` or a diagnosis's `report.json` lists.

    Beside a model stands what is not in it. Of an effect that is native, as its entry says, the
    model has what MuJoCo expresses; such an entry tells the rest.

    Raises:
        BadInputError: the file is missing, or does not list known effects as expected.
    """
    if not path.is_file():
        raise BadInputError(f"effects {path}: no such file")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as exc:
        raise BadInputError(f"effects {path}: {exc}; expected JSON") from exc
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema not in (BESIDE, REPORT):
        raise BadInputError(
            f"effects {path}: schema {schema!r}, expected one of {BESIDE}, {REPORT}"
        )
    entries = document.get("effects")
    if not isinstance(entries, list):
        raise BadInputError(f"effects {path}: effects {entries!r}, expected a list")
    return tuple(_instance(entry, f"effects {path}", beside=schema == BESIDE) for entry in entries)


def check_joints(effect: Effect, joints: Sequence[str], where: str) -> None:
    """Raises BadInputError where an effect acts on another number of joints than it is told."""
    if len(joints) != _JOINTS.get(effect.scope, len(joints)):
        raise BadInputError(
            f"{where}: {effect.name} on {', '.join(joints) or 'no joint'}; "
            f"expected {_JOINTS[effect.scope]}"
        )


def _instance(entry: Mapping[str, Any], where: str, *, beside: bool) -> EffectInstance:
    try:
        effect = find_effect(entry["effect"])
        joints = tuple(str(name) for name in entry["joints"])
        amounts = {name: float(p["value"]) for name, p in entry["parameters"].items()}
    except UnknownNameError as exc:
        raise BadInputError(f"{where}: {exc}") from exc
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
    if not effect.possible(amounts):
        raise BadInputError(f"{where}: {effect.name} {amounts}: out of bounds")
    check_joints(effect, joints, where)
    in_model = beside and effect.native and entry.get("native") is True
    return EffectInstance(effect=effect, joints=joints, values=amounts, in_model=in_model)
