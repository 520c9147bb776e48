"""Draws cases from their plans, simulates them, and writes what a user would have: files.

A size is drawn for each effect, then made stronger or weaker until it changes the motion by enough
to be found (at least five times the sensor noise) and not by so much that nothing else is seen.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np

from known_truth.amounts import Hidden
from known_truth.mjcf import mjcf
from known_truth.motion import MOTIONS
from known_truth.outside import SLIPPING
from known_truth.plans import HELD_OUT, Plan
from known_truth.recordings import Sensors, write_recording
from known_truth.robots import Robot, varied
from known_truth.simulation import STEP_S, Course, Run, simulate
from known_truth.sizes import DRAWS, Place

#: Change of the motion, in units of the sensor noise, that an effect must make, and may.
LEAST_SIGNAL, MOST_SIGNAL = 5.0, 2000.0
#: How often a size is tried before another joint is, and by how much it is changed at most.
_TRIES, _FACTOR = 3, 6.0
#: Robots simulated side by side.
_BATCH = 320
#: Recordings on which sizes are tried, and how much of each, s.
_TRIED, _TRIED_S = 2, 5.0
#: Commands begin so long before the first measurement, time steps.
_BEFORE = 400
_LAST = ("payload", SLIPPING)


@final
@dataclass(kw_only=True, eq=False)
class Draft:
    """A case while its sizes are being found.

    Attributes:
        plan: What it is about.
        robot: As built.
        runs: Of its recordings, nothing hidden.
        names: Of the recordings: role and motion.
        sensors: Of the robot.
        nominal: What the robot would do with nothing hidden, on the tried recordings.
        joints: In which order joints are tried.
        found: Sizes that were found.
        signals: How much each changes the motion, in units of the sensor noise.
        attempt: How often sizes were tried for the next effect.
        strength: Of the next effect's size.
    """

    plan: Plan
    robot: Robot
    runs: list[Run]
    names: list[str]
    sensors: Sensors
    nominal: list[Course] = field(default_factory=list)
    joints: list[int]
    found: list[Hidden] = field(default_factory=list)
    signals: list[float] = field(default_factory=list)
    attempt: int = 0
    strength: float = 1.0

    @property
    def complete(self) -> bool:
        """Whether all sizes are found."""
        return len(self.found) == len(self.plan.effects)

    def candidate(self) -> Hidden:
        """Returns the next effect as it is to be tried."""
        number = len(self.found)
        effect, rng = self.plan.effects[number], np.random.default_rng([self.plan.seed, 7, number])
        joints = self._joints(effect, number)
        place = Place(
            robot=self.robot,
            joint=joints[0] if joints else 0,
            servo=np.concatenate([c.servo[:, joints[0] if joints else 0] for c in self.nominal]),
            effort=np.concatenate([c.effort[:, joints[0] if joints else 0] for c in self.nominal]),
        )
        parameters = DRAWS[effect](place, rng, self.strength)
        return Hidden(effect=effect, joints=joints, parameters=parameters)

    def _joints(self, effect: str, number: int) -> tuple[int, ...]:
        count = len(self.robot.joints)
        if effect == "gravity_direction":
            return ()
        if effect == "command_delay":
            return tuple(range(count))
        if effect in _LAST:
            return (count - 1,)
        turn = self.attempt // _TRIES
        if self.plan.same_joint and self.found:
            return self.found[0].joints
        one = self.joints[(turn + number) % count]
        if effect == "coupled_friction":
            one = min(one, count - 2)
            return (one, one + 1)
        return (one,)

    def judge(self, candidate: Hidden, signal: float) -> None:
        """Takes the candidate if its signal is right, else changes what is tried next."""
        poor = self.plan.category == "poor"
        if poor or LEAST_SIGNAL <= signal <= MOST_SIGNAL:
            self.found.append(candidate)
            self.signals.append(signal)
            self.attempt, self.strength = 0, 1.0
            return
        self.attempt += 1
        if self.attempt > _TRIES * len(self.joints):
            raise RuntimeError(f"{self.plan.name}: no size of {candidate.effect} can be seen")
        aim = 3.0 * LEAST_SIGNAL if signal < LEAST_SIGNAL else 0.3 * MOST_SIGNAL
        self.strength *= float(np.clip(aim / signal, 1.0 / _FACTOR, _FACTOR)) if signal else _FACTOR
        if self.attempt % _TRIES == 0:
            self.strength = 1.0


def generate(plans: Sequence[Plan], folder: Path) -> None:
    """Writes the cases that are not there yet: `cases/NAME`, and what they hide, `truth/NAME.json`.

    What is judged is told of the first alone.
    """
    missing = [plan for plan in plans if not (folder / "truth" / f"{plan.name}.json").exists()]
    builds = dict.fromkeys(plan.setup.robot.joints for plan in missing)
    for build in builds:
        drafts = [draft(plan) for plan in missing if plan.setup.robot.joints == build]
        for some in _portions(drafts):
            _find_sizes(some)
            _write_all(some, folder)


def _portions(drafts: Sequence[Draft]) -> Iterator[list[Draft]]:
    """Yields drafts that can be simulated side by side."""
    portion: list[Draft] = []
    for one in drafts:
        if portion and sum(len(d.runs) for d in portion) + len(one.runs) > _BATCH:
            yield portion
            portion = []
        portion.append(one)
    if portion:
        yield portion


def draft(plan: Plan) -> Draft:
    """Returns a case with its robot, motions and sensors drawn."""
    rng = np.random.default_rng([plan.seed, 1])
    robot = varied(plan.setup.robot, rng)
    joints = [int(j) for j in rng.permutation(len(robot.joints))]
    if "asymmetric_friction" in plan.effects and not plan.same_joint:
        # Friction that differs with the direction needs friction that can differ.
        robot = replace(robot, friction=0.15 * robot.torque)
    moved = _slowed(robot, plan, joints[0])
    motions = [(f"train_{i}", m) for i, m in enumerate(plan.setup.training)]
    motions += [(f"held_{i}", m) for i, m in enumerate(HELD_OUT)]
    every, measured_every = int(rng.choice([20, 40])), int(rng.choice([10, 20]))
    runs, names = [], []
    for i, (role, motion) in enumerate(motions):
        kind = plan.setup.kinds[i % len(plan.setup.kinds)]
        runs.append(_run(robot, moved, kind, motion, plan, every, measured_every, rng))
        names.append(f"{role}_{motion}_{kind}")
    sensors = Sensors(
        encoder_step=robot.encoder_step,
        encoder_noise=robot.encoder_noise,
        velocity_noise=0.005 if rng.random() < 0.6 else None,
        effort_noise=0.01 * robot.torque if rng.random() < 0.6 else None,
    )
    return Draft(plan=plan, robot=robot, runs=runs, names=names, sensors=sensors, joints=joints)


def _slowed(robot: Robot, plan: Plan, joint: int) -> Robot:
    """Returns the robot as it is to be moved."""
    match plan.excitation:
        case "still":
            reach = robot.reach.copy()
            reach[joint] *= 0.003
            return replace(robot, reach=reach)
        case "slow":
            return replace(robot, speed=0.04 * robot.speed)
        case _:
            return robot


def _run(
    robot: Robot,
    moved: Robot,
    kind: str,
    motion: str,
    plan: Plan,
    every: int,
    measured_every: int,
    rng: np.random.Generator,
) -> Run:
    duration_s = 2.0 if plan.excitation == "short" else plan.setup.duration_s
    end = round(duration_s / STEP_S)
    # Commands and measurements follow clocks of their own.
    first = -_BEFORE + int(rng.integers(0, every))
    count = (end - first) // every + 1
    time_s = (first + every * np.arange(count)) * STEP_S
    path = MOTIONS[motion](moved, np.maximum(time_s, 0.0), rng)
    reference = path
    if kind == "velocity":
        steps = np.diff(path, axis=0) / (every * STEP_S)
        reference = np.concatenate([steps, np.zeros((1, len(robot.joints)))])
    return Run(
        robot=robot,
        kind=kind,
        hidden=(),
        start=path[0],
        first_command_step=first,
        command_every=every,
        reference=reference,
        control=(0.4 * robot.stiffness, 0.7 * robot.servo_damping),
        measured_at=np.arange(0, end + 1, measured_every),
    )


def _find_sizes(drafts: Sequence[Draft]) -> None:
    """Finds sizes for all effects of all drafts, in rounds."""
    tried = [one for one in drafts if one.plan.effects]
    courses = simulate([run for one in tried for run in _beginnings(one)]) if tried else []
    for i, one in enumerate(tried):
        one.nominal = courses[_TRIED * i : _TRIED * (i + 1)]
    while open_ := [one for one in tried if not one.complete]:
        candidates = [one.candidate() for one in open_]
        runs = [
            replace(run, hidden=(candidate,))
            for one, candidate in zip(open_, candidates, strict=True)
            for run in _beginnings(one)
        ]
        courses = simulate(runs)
        for i, (one, candidate) in enumerate(zip(open_, candidates, strict=True)):
            one.judge(candidate, _signal(one, courses[_TRIED * i : _TRIED * (i + 1)]))


def _beginnings(one: Draft) -> list[Run]:
    """Returns the beginnings of the recordings on which sizes are tried."""
    end = round(_TRIED_S / STEP_S)
    return [replace(r, measured_at=r.measured_at[r.measured_at <= end]) for r in one.runs[:_TRIED]]


def _signal(one: Draft, courses: Sequence[Course]) -> float:
    """Returns the RMS change of the joint that changes most, in units of the sensor noise."""
    change = np.concatenate(
        [a.position - b.position for a, b in zip(courses, one.nominal, strict=True)]
    )
    return float(np.sqrt(np.mean(change**2, axis=0)).max() / one.sensors.position_std)


def _write_all(drafts: Sequence[Draft], folder: Path) -> None:
    runs = [replace(run, hidden=tuple(one.found)) for one in drafts for run in one.runs]
    courses = iter(zip(runs, simulate(runs), strict=True))
    for one in drafts:
        place = folder / "cases" / one.plan.name
        rng = np.random.default_rng([one.plan.seed, 2])
        for name in one.names:
            run, course = next(courses)
            write_recording(place / f"{name}.mcap", run, course, one.sensors, rng)
        for kind in one.plan.setup.kinds:
            (place / f"model_{kind}.xml").write_text(mjcf(one.robot, kind))
        hidden = folder / "truth" / f"{one.plan.name}.json"
        hidden.parent.mkdir(exist_ok=True)
        hidden.write_text(json.dumps(truth(one), indent=1) + "\n")


def truth(one: Draft) -> dict[str, object]:
    """Returns what a case hides, as it is written for whoever judges."""
    names = one.robot.joints
    return {
        "name": one.plan.name,
        "setup": one.plan.setup.name,
        "category": one.plan.category,
        "excitation": one.plan.excitation,
        "seed": one.plan.seed,
        "noise": one.sensors.position_std,
        "effects": [
            {
                "effect": hidden.effect,
                "joints": [names[j] for j in hidden.joints],
                "parameters": dict(hidden.parameters),
                "signal": signal,
                "equals": [
                    {"effect": effect, "joints": [names[j] for j in joints]}
                    for effect, joints in equals(one.robot, hidden)
                ],
                "unseen": unseen(one.robot, hidden),
            }
            for hidden, signal in zip(one.found, one.signals, strict=True)
        ],
    }


def equals(robot: Robot, hidden: Hidden) -> list[tuple[str, tuple[int, ...]]]:
    """Returns what physics cannot tell from a hidden effect."""
    same: Mapping[str, str] = {
        "asymmetric_friction": "torque_offset",
        "torque_offset": "asymmetric_friction",
    }
    if hidden.effect in same:
        return [(same[hidden.effect], hidden.joints)]
    if robot.planar and hidden.effect == "gravity_direction":
        return [("encoder_offset", (0,))]
    if robot.planar and hidden.effect == "encoder_offset" and hidden.joints == (0,):
        return [("gravity_direction", ())]
    return []


def unseen(robot: Robot, hidden: Hidden) -> list[str]:
    """Returns parameters that no motion of the robot shows."""
    if robot.planar and hidden.effect == "gravity_direction":
        return ["tilt_x"]
    return ["com_y"] if robot.planar and hidden.effect == "payload" else []
