"""The sealed file: what the simulated robot hides, to be opened after the verdict."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from gfm.core import BadInputError
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.simulated.hidden import HiddenEffect, unit

SCHEMA = "gfm.sealed/1"


def seal(path: Path, effects: Sequence[HiddenEffect], *, choice: str, seed: int) -> None:
    """Writes what is hidden, at once and readable by this user only.

    Args:
        path: The file.
        effects: What is hidden, the one that was asked for first.
        choice: What was asked for: an effect's name, `random` or `none`.
        seed: Of the draw.
    """
    document = {
        "schema": SCHEMA,
        "note": "sealed until the verdict: whoever diagnoses must not read this",
        "choice": choice,
        "seed": seed,
        "effects": [_as_document(effect) for effect in effects],
    }
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            json.dump(document, file, indent=2)
        part.replace(path)
    except OSError as exc:
        raise BadInputError(f"{path}: the sealed file cannot be written: {exc.strerror}") from exc


def _as_document(effect: HiddenEffect) -> dict[str, object]:
    return {
        "effect": effect.effect,
        "joints": [JOINT_NAMES[joint] for joint in effect.joints],
        "parameters": {
            name: {"value": value, "unit": unit(effect.effect, name)}
            for name, value in effect.parameters.items()
        },
    }
