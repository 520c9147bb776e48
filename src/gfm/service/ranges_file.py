"""Ranges of a robot's amounts in a file: what `gfm diagnose --since` wrote, to be drawn from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gfm.core import BadInputError, UnknownNameError
from gfm.effects import EffectInstance, find_effect
from gfm.service.effects_file import check_joints
from gfm.sim.ranges import EffectRange

SCHEMA = "gfm.ranges/1"


def read_ranges(path: Path) -> tuple[EffectRange, ...]:
    """Returns the ranges in a file.

    Raises:
        BadInputError: it is missing, or does not list ranges of known effects as expected.
    """
    where = f"ranges {path}"
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise BadInputError(f"{where}: cannot be read: {exc.strerror}") from exc
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as exc:
        raise BadInputError(f"{where}: not TOML: {exc}") from exc
    if document.get("schema") != SCHEMA:
        raise BadInputError(f"{where}: schema {document.get('schema')!r}, expected {SCHEMA}")
    return tuple(_range(entry, where) for entry in document.get("effects", []))


def _range(entry: Mapping[str, Any], where: str) -> EffectRange:
    try:
        effect = find_effect(entry["effect"])
        joints = tuple(str(name) for name in entry["joints"])
        told = {p.name: entry["parameters"][p.name] for p in effect.parameters}
        mean, low, high = (
            {name: float(one[key]) for name, one in told.items()} for key in ("mean", "low", "high")
        )
    except UnknownNameError as exc:
        raise BadInputError(f"{where}: {exc}") from exc
    except (KeyError, TypeError, ValueError) as exc:
        raise BadInputError(
            f"{where}: {exc!r} in {str(entry)[:80]}; expected effect, joints, and parameters with "
            "mean, low and high each"
        ) from exc
    check_joints(effect, joints, where)
    crossed = [name for name in told if not low[name] <= high[name]]
    if crossed or not (effect.possible(low) and effect.possible(high)):
        raise BadInputError(
            f"{where}: {effect.name} from {low} to {high}; expected possible amounts, low before "
            "high"
        )
    usual = EffectInstance(effect=effect, joints=joints, values=mean)
    return EffectRange(usual=usual, low=low, high=high)
