"""What learned forces say, as `report.json` has it and in words, beside the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gfm.diagnosis.learned import LearnedReport
from gfm.diagnosis.output.result import Diagnosis
from gfm.report import words

#: Share of the learned forces from which on their names tell what was learned.
MOSTLY = 0.5


@dataclass(frozen=True, kw_only=True)
class BothSay:
    """One amount of one effect, from the recordings and from the learned forces.

    None where the effect was not named.
    """

    effect: str
    joints: tuple[str, ...]
    parameter: str
    unit: str
    recordings: float | None
    learned: float | None
    share: float | None


def both_say(diagnosis: Diagnosis) -> list[BothSay]:
    """Returns every amount that the recordings or the learned forces name."""
    return list(_rows(diagnosis)) if diagnosis.gfm else []


def _rows(diagnosis: Diagnosis) -> Iterator[BothSay]:
    found = {one.key: one for one in diagnosis.effects}
    learned = {one.instance.key: one for one in (diagnosis.gfm.names if diagnosis.gfm else ())}
    for key in dict.fromkeys([*learned, *found]):
        mine, other = learned.get(key), found.get(key)
        units = {p.name: p.unit for p in mine.instance.effect.parameters} if mine else {}
        if other:
            units |= {name: one.unit for name, one in other.parameters.items()}
        for name, unit in units.items():
            yield BothSay(
                effect=key[0],
                joints=key[1],
                parameter=name,
                unit=unit,
                recordings=other.parameters[name].value if other else None,
                learned=mine.instance.values[name] if mine else None,
                share=mine.share if mine else None,
            )


def learned_sentence(diagnosis: Diagnosis) -> str:
    """Returns whether the learned forces say what the recordings say; empty without any."""
    told = diagnosis.gfm
    if told is None:
        return ""
    if all(one.named is None for one in told.joints):
        return "The learned forces are too small beside the drives to be named."
    share = words.percent(told.named_share)
    if not told.names:
        return "No named effect explains what was learned: it stays a learned force."
    found = {one.key for one in diagnosis.effects}
    learned = {one.instance.key for one in told.names}
    named = f"Names explain {share} of the learned forces"
    if learned == found:
        return f"{named}, the same that the recordings support."
    if learned & found:
        return f"{named}; some of them are those that the recordings support, some are not."
    beside = "; the recordings support others" if found else "; the recordings support none"
    doubt = "" if told.named_share >= MOSTLY else " Most of what was learned has no name."
    return f"{named}{beside}. A name on which both agree would be worth more.{doubt}"


def learned_json(diagnosis: Diagnosis) -> dict[str, object] | None:
    """Returns the part `gfm` of `report.json`; None where no forces were given."""
    told = diagnosis.gfm
    if told is None:
        return None
    return {
        "members": told.members,
        "spread": told.spread,
        "named_share": told.named_share,
        "sentence": learned_sentence(diagnosis),
        "effects": _effects(told),
        "joints": [dict(vars(one)) for one in told.joints],
    }


def _effects(told: LearnedReport) -> list[dict[str, object]]:
    return [
        {
            "effect": one.instance.effect.name,
            "joints": list(one.instance.joints),
            "parameters": {
                p.name: {"value": one.instance.values[p.name], "unit": p.unit}
                for p in one.instance.effect.parameters
            },
            "share": one.share,
        }
        for one in told.names
    ]
