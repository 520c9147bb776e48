"""Arms that people have, in the numbers of their published models (`arms.json`), and their cases.

Each link's frame is turned along the principal axes of its inertia, so that moments are enough; a
link includes what is fixed to it. Where the models have motors only, servos are those of the loop
that closes over torques.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from known_truth.plans import PAIRS, VOCABULARY, Plan, Setup
from known_truth.robots import Robot

_NUMBERS = Path(__file__).with_name("arms.json")
_MOTIONS = ("waypoints", "multisine", "ladder", "waypoints", "multisine", "ladder")
_DURATION_S = 12.0
#: What is told of each joint, and called the same in `Robot`.
_COLUMNS = (
    *("offset", "turn", "axis", "mass", "com", "inertia", "armature", "damping", "friction"),
    *("stiffness", "servo_damping", "rest", "reach", "speed", "torque"),
)
#: Pairs of effects on each arm.
_PAIRS_EACH = 3


def arms() -> dict[str, Robot]:
    """Returns the arms by name."""
    return {name: _robot(name, numbers) for name, numbers in _numbers().items()}


def _numbers() -> Mapping[str, Mapping[str, Any]]:
    return json.loads(_NUMBERS.read_text())  # type: ignore[no-any-return]


def _robot(name: str, numbers: Mapping[str, Any]) -> Robot:
    rows: Sequence[Mapping[str, Any]] = numbers["joints"]
    columns: dict[str, Any] = {name: np.array([row[name] for row in rows]) for name in _COLUMNS}
    columns["axis"] /= np.linalg.norm(columns["axis"], axis=1, keepdims=True)
    return Robot(
        name=name,
        joints=tuple(row["name"] for row in rows),
        velocity_gain=columns["servo_damping"],
        encoder_step=numbers["encoder_step"],
        encoder_noise=numbers["encoder_noise"],
        **columns,
    )


def arm_plans(seed: int = 0) -> list[Plan]:
    """Returns all cases of published arms; each has a seed of its own.

    Every effect is hidden once, on another arm with another seed; on every arm pairs, and nothing.
    """
    made: list[Plan] = []
    for number, (name, robot) in enumerate(arms().items()):
        setup = Setup(
            name=name,
            robot=robot,
            kinds=tuple(_numbers()[name]["kinds"]),
            training=_MOTIONS,
            duration_s=_DURATION_S,
            as_published=True,
        )
        listed = _plans(setup, (number + seed) % len(arms()))
        first = 1_000_000 * seed + 500_000 + 1000 * number
        made += [replace(plan, seed=first + i) for i, plan in enumerate(listed)]
    return made


def _plans(setup: Setup, turn: int) -> list[Plan]:
    name, count = setup.name, len(_numbers())
    singles = VOCABULARY[turn::count]
    pairs = [PAIRS[(turn * _PAIRS_EACH + i) % len(PAIRS)] for i in range(_PAIRS_EACH)]
    return [
        *(
            Plan(name=f"{name}-{e}", setup=setup, category="single", effects=(e,), seed=0)
            for e in singles
        ),
        *(
            Plan(
                name=f"{name}-{a}+{b}",
                setup=setup,
                category="pair",
                effects=(a, b),
                same_joint=same,
                seed=0,
            )
            for a, b, same in pairs
        ),
        Plan(name=f"{name}-none", setup=setup, category="none", seed=0),
    ]
