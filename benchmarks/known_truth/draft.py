"""A case while it is drawn: robot, motions, sensors, and sizes that are still being found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from known_truth.amounts import Hidden
from known_truth.motion import MOTIONS
from known_truth.outside import SLIPPING
from known_truth.plans import HELD_OUT, Plan
from known_truth.recordings import Sensors
from known_truth.robots import Robot, varied
from known_truth.run import STEP_S, Course, Run
from known_truth.sizes import DRAWS, Place

#: Change of the motion, in units of the sensor noise, that an effect must make, and may.
LEAST_SIGNAL, MOST_SIGNAL = 5.0, 2000.0
#: Recordings by which a size is judged.
TRIED = 2
#: How often a size is tried before another joint is, and by how much it is changed at most.
_TRIES, _FACTOR = 3, 6.0
#: How often the gains of a loop over torques are halved that an effect makes unstable.
_SOFTER = 3
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
        nominal: What the robot would do with nothing hidden, on the tried recordings; empty where
            that is still to be simulated.
        joints: In which order joints are tried.
        found: Sizes that were found.
        signals: How much each changes the motion, in units of the sensor noise.
        attempt: How often sizes were tried for the next effect.
        strength: Of the next effect's size.
        softer: How often the gains of its loop were halved.
        given_up: Whether no size of an effect can be seen in these motions: there is no such case.
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
    softer: int = 0
    given_up: bool = False

    @property
    def complete(self) -> bool:
        """Whether all sizes are found, or looked for no longer."""
        return self.given_up or len(self.found) == len(self.plan.effects)

    def candidate(self) -> Hidden:
        """Returns the next effect as it is to be tried."""
        number = len(self.found)
        effect, rng = self.plan.effects[number], np.random.default_rng([self.plan.seed, 7, number])
        joints = self._joints(effect, number)
        joint, courses = joints[0] if joints else 0, self.nominal[:TRIED]
        place = Place(
            robot=self.robot,
            joint=joint,
            servo=np.concatenate([c.servo[:, joint] for c in courses]),
            effort=np.concatenate([c.effort[:, joint] for c in courses]),
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
        unseen = effect == "encoder_offset" and self.robot.upright
        able = [joint for joint in self.joints if joint > 0 or not unseen]
        if self.plan.category == "everywhere":
            return (able[number],)
        one = able[(turn + number) % len(able)]
        if effect == "coupled_friction":
            one = min(one, count - 2)
            return (one, one + 1)
        return (one,)

    def judge(self, candidate: Hidden, signal: float) -> None:
        """Takes the candidate if its signal is right, else changes what is tried next.

        An infinite signal is that of an unstable loop.
        """
        if np.isinf(signal) and self.softer < _SOFTER and "effort" in self.plan.setup.kinds:
            self._soften()
            return
        poor = self.plan.category == "poor" and np.isfinite(signal)
        if poor or LEAST_SIGNAL <= signal <= MOST_SIGNAL:
            self.found.append(candidate)
            self.signals.append(signal)
            self.attempt, self.strength = 0, 1.0
            return
        self.attempt += 1
        if self.attempt > _TRIES * len(self.joints):
            print(f"{self.plan.name}: left out, no size of {candidate.effect} can be seen")
            self.given_up = True
        aim = 3.0 * LEAST_SIGNAL if signal < LEAST_SIGNAL else 0.3 * MOST_SIGNAL
        self.strength *= float(np.clip(aim / signal, 1.0 / _FACTOR, _FACTOR)) if signal else _FACTOR
        if self.attempt % _TRIES == 0:
            self.strength = 1.0

    def _soften(self) -> None:
        """Halves the gains of the loop, as everybody does whose robot begins to shake."""
        stiffness, damping = self.runs[0].control
        control = (0.5 * stiffness, 0.5 * damping)
        self.runs = [replace(run, control=control) for run in self.runs]
        self.nominal, self.softer = [], self.softer + 1


def draft(plan: Plan) -> Draft:
    """Returns a case with its robot, motions and sensors drawn."""
    rng = np.random.default_rng([plan.seed, 1])
    built = plan.setup.robot
    robot = built if plan.setup.as_published else varied(built, rng)
    joints = [int(j) for j in rng.permutation(len(robot.joints))]
    if "asymmetric_friction" in plan.effects and not plan.same_joint:
        # Friction that differs with the direction needs friction that can differ.
        robot = replace(robot, friction=np.maximum(robot.friction, 0.15 * robot.torque))
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


def _measured_at(end: int, every: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Returns the time steps of measurements: no bus delivers them quite evenly."""
    even = np.arange(0, end + 1, every)
    loose = int(rng.integers(0, every // 5 + 1))
    return np.clip(even + rng.integers(-loose, loose + 1, len(even)), 0, end)


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
        measured_at=_measured_at(end, measured_every, rng.spawn(1)[0]),
    )
