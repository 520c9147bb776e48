"""How recorded motions lie in the model's ranges, and what they can show.

Shape letters: J joints.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from gfm.api.doctor.lines import doubt, some, well
from gfm.api.recordings import Files
from gfm.core import CommandKind
from gfm.excitation.blind_spots import ANY, BlindSpot, blind_spots
from gfm.excitation.limits import drive_limit
from gfm.excitation.rules import RULES, saturation_rule
from gfm.report.checks import Check
from gfm.sim.plant import Plant

RANGES, CONTROL, CONTACTS, SEEN = (
    "joint ranges",
    "control ranges",
    "contacts",
    "what can be found",
)
#: Poses of each recording in which contacts are looked for, and pairs of bodies that are told.
_LOOKS, _PAIRS = 50, 4


def ranges(files: Files, plants: Mapping[CommandKind, Plant]) -> Iterator[Check]:
    """Checks recorded positions against the ranges of the model's joints."""
    model = next(iter(plants.values())).model
    low, high = _reach(files)
    beyond, shares = [], []
    for j, name in enumerate(files[0][1].joint_names):
        joint = model.joint(name)
        if not joint.limited[0]:
            continue
        least, most = map(float, joint.range)
        shares.append((high[j] - low[j]) / (most - least))
        if low[j] < least or high[j] > most:
            told = f"{name} went from {low[j]:.3g} to {high[j]:.3g}, its range is {least:.3g} to"
            beyond.append(f"{told} {most:.3g} rad")
    for words in beyond:
        advice = "widen the range in the model, or check the joint's zero: a stop would push back"
        yield doubt(RANGES, words, advice)
    if not shares:
        yield well(RANGES, "no joint of the model has one")
    elif not beyond:
        used = f"{100 * min(shares):.0f} to {100 * max(shares):.0f} % of them"
        yield well(RANGES, f"recorded positions are inside and cover {used}")


def contacts(files: Files, plants: Mapping[CommandKind, Plant]) -> Iterator[Check]:
    """Tells which parts touch in recorded poses: a robot is judged by its motion in the air."""
    poses, touching = 0, Counter[str]()
    for _, run in files:
        plant = plants[run.command_kind]
        rows = np.linspace(0, len(run.position) - 1, _LOOKS).astype(int)
        data = mujoco.MjData(plant.model)
        poses += len(rows)
        for position in run.position[rows]:
            data.qpos[plant.qpos] = position
            mujoco.mj_fwdPosition(plant.model, data)
            touching.update(_pairs(plant.model, data))
    for pair, count in touching.most_common(_PAIRS):
        advice = (
            "nothing, if they do; if not, exclude the pair in MJCF (contact, exclude), or leave "
            "their geometry out: contacts hide what else is wrong, and take long to simulate"
        )
        share = 100.0 * count / poses
        yield doubt(CONTACTS, f"{pair} touch in {share:.0f} % of the recorded poses", advice)
    if not touching:
        yield well(CONTACTS, f"nothing touches in {poses} recorded poses")


def _pairs(model: mujoco.MjModel, data: mujoco.MjData) -> set[str]:
    """Returns the bodies that touch, as "a and b"."""
    bodies = model.geom_bodyid[data.contact.geom[: data.ncon]].tolist()
    named = (sorted(model.body(i).name for i in pair) for pair in bodies)
    return {f"{first} and {second}" for first, second in named}


def _reach(files: Files) -> tuple[np.ndarray, np.ndarray]:
    """Returns the lowest and the highest position over all recordings, shape (J,) each."""
    low = np.min([run.position.min(axis=0) for _, run in files], axis=0)
    high = np.max([run.position.max(axis=0) for _, run in files], axis=0)
    return low, high


def control_ranges(files: Files, plants: Mapping[CommandKind, Plant]) -> Iterator[Check]:
    """Checks recorded commands against what the model's actuators take: MuJoCo clips the rest."""
    beyond: dict[str, str] = {}
    for _, run in files:
        model = plants[run.command_kind].model
        for j, name in enumerate(run.joint_names):
            if name in run.uncommanded or not model.actuator(name).ctrllimited[0]:
                continue
            least, most = map(float, model.actuator(name).ctrlrange)
            low, high = float(run.command[:, j].min()), float(run.command[:, j].max())
            if low < least or high > most:
                told = f"{name} was told {low:.3g} to {high:.3g}, its actuator takes {least:.3g} to"
                beyond.setdefault(name, f"{told} {most:.3g}: the model clips the rest")
    for words in beyond.values():
        advice = "widen ctrlrange to what the robot takes; if it clips as well, leave it"
        yield doubt(CONTROL, words, advice)
    if not beyond:
        yield well(CONTROL, "recorded commands are inside")


def seen(
    training: Files, plants: Mapping[CommandKind, Plant], models: tuple[Path, ...]
) -> Iterator[Check]:
    """Tells which effects the motions can show, and by motion those that they cannot."""
    limits = _torque_limits(training, [plant.model for plant in plants.values()])
    spots = blind_spots([run for _, run in training], limits)
    joints = len(training[0][1].joint_names)
    rules = (*RULES, saturation_rule(limits)) if limits else RULES
    known = [rule.effect for rule in rules if rule.joints <= joints]
    hidden = {spot.effect for spot in spots}
    shown = [effect for effect in known if effect not in hidden]
    if shown:
        found = f"{len(shown)} of {len(known)} effects on every joint that moved"
        yield replace(well(SEEN, found), details=tuple(shown))
    by_motion: dict[str, list[BlindSpot]] = {}
    for spot in spots:
        by_motion.setdefault(spot.motion, []).append(spot)
    for motion, unseen in by_motion.items():
        yield replace(
            doubt(SEEN, f"not {', '.join(map(_named, unseen))}", _excite(motion, unseen, models)),
            details=tuple(f"{_named(spot)}: {spot.why}" for spot in unseen),
        )


def _named(spot: BlindSpot) -> str:
    effect = "anything" if spot.effect == ANY else spot.effect
    return f"{effect} on {some(spot.joints)}" if spot.joints else effect


def _excite(motion: str, unseen: Sequence[BlindSpot], models: tuple[Path, ...]) -> str:
    """Returns the command that proposes a motion, and what that is."""
    given = "".join(f" --model {path}" for path in models)
    wanted = [spot.effect for spot in unseen if spot.effect != ANY]
    asked = f" --for {' '.join(wanted)}" if wanted else ""
    return f"{motion.partition(': ')[2]}: gfm excite{given}{asked} --out plan"


def _torque_limits(files: Files, models: list[mujoco.MjModel]) -> dict[str, float]:
    """Returns the torque limits of drives that the models tell, N m, by joint."""
    joints = files[0][1].joint_names
    known = {name: min(drive_limit(model, name) for model in models) for name in joints}
    return {name: limit for name, limit in known.items() if np.isfinite(limit)}
