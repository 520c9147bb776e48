"""Opens the sealed file in which a simulated robot wrote what it hides. After the verdict only."""

from __future__ import annotations

import json
from pathlib import Path

from gfm.core import BadInputError
from gfm.report import HiddenEffect, HiddenParameter

_SCHEMA = "gfm.sealed/1"


def unseal(path: Path) -> tuple[HiddenEffect, ...]:
    """Returns what was hidden, the effect that was asked for first; empty where nothing was.

    Raises:
        BadInputError: it cannot be read or is something else.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["schema"] != _SCHEMA:
            raise BadInputError(f"{path}: schema {document['schema']!r}, expected {_SCHEMA!r}")
        return tuple(_effect(one) for one in document["effects"])
    except OSError as exc:
        raise BadInputError(f"{path}: cannot be read: {exc.strerror}") from exc
    except (ValueError, KeyError, TypeError) as exc:
        raise BadInputError(f"{path}: not a sealed file ({exc}), expected {_SCHEMA}") from exc


def _effect(one: dict[str, object]) -> HiddenEffect:
    joints, parameters = one["joints"], one["parameters"]
    if not isinstance(joints, list) or not isinstance(parameters, dict):
        raise TypeError("joints or parameters of the wrong type")
    return HiddenEffect(
        effect=str(one["effect"]),
        joints=tuple(str(joint) for joint in joints),
        parameters={
            str(name): HiddenParameter(value=float(entry["value"]), unit=str(entry["unit"]))
            for name, entry in parameters.items()
        },
    )
