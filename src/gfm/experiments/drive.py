"""Drives the robot along motions, through the bridge, and has them recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gfm.core import Clock, CommandKind, Observation, RefusedError
from gfm.core.checks import Array
from gfm.excitation.motion import JointRanges, Motion, Purpose
from gfm.experiments.driver import Driver
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.sim.sawyer_numbers import JOINTS
from gfm.transport import Transport

#: Velocity commands follow the reference with this gain on the position error, 1/s: enough to stay
#: on it, too little to hide what the drives do.
_FEEDBACK = 2.0
#: A motion asks for so much more than its own speeds, and at least for that share of the limits:
#: what fell behind has to catch up.
_ROOM, _LEAST_SHARE = 2.0, 0.05


@dataclass(frozen=True, kw_only=True)
class Driven:
    """One motion that was driven and recorded.

    Attributes:
        name: Of the motion.
        purpose: Training or held out.
        kind: Of its commands.
        path: The recording, where the bridge wrote it.
        reports: Sensor reports in it.
    """

    name: str
    purpose: Purpose
    kind: CommandKind
    path: Path
    reports: int


def sawyer_ranges() -> JointRanges:
    """Returns where the arm may be driven: around the pose above the basket, at half speed."""
    return JointRanges(
        joint_names=JOINT_NAMES,
        center=READY,
        half_width=np.array([0.5, 0.35, 0.5, 0.4, 0.7, 0.5, 0.8]),
        speed=np.array([0.75, 0.55, 0.85, 0.85, 1.0, 1.0, 1.0]),
        acceleration=np.array([10.0, 8.0, 10.0, 10.0, 12.0, 12.0, 12.0]),
    )


def drive(
    transport: Transport,
    clock: Clock,
    motions: Sequence[Motion],
    *,
    wait_s: float = 30.0,
    idle: Callable[[], None] | None = None,
    before: Callable[[Observation], None] | None = None,
) -> Iterator[Driven]:
    """Drives motions one after the other; yields each when its recording is complete.

    Args:
        transport: The connection to the run in which the bridge is.
        clock: To wait by.
        motions: What to drive.
        wait_s: How long to wait for the bridge and the robot at first.
        idle: Called while waiting for an answer; sleeps a little by default.
        before: Called with the first observation, before anything moves; may raise.

    Raises:
        UnreachableError: no bridge, or no robot behind it.
        RefusedError: the bridge said no.
        BadInputError: the bridge has another control period than a motion.
    """
    driver = Driver(transport, clock, idle)
    driver.begin(motions[0].joint_names, wait_s)
    if before is not None:
        before(driver.newest)
    for motion in motions:
        yield record_motion(driver, motion)
    driver.release()


def _approach(driver: Driver, motion: Motion) -> None:
    """Goes to where a motion begins and comes to rest there, in the motion's mode."""
    driver.go_to(motion.joint_names, motion.position[0], motion.period_s)
    if motion.kind is not CommandKind.POSITION:
        _follow(driver, motion, 0, np.zeros(len(motion.joint_names)), speed_share(motion))


def record_motion(driver: Driver, motion: Motion) -> Driven:
    """Goes to where a motion begins, and drives it while the bridge records it.

    Raises:
        RefusedError: the bridge says no.
        BadInputError: it has another control period.
    """
    _approach(driver, motion)
    about = {"purpose": str(motion.purpose), "motion": motion.name}
    began_ns, share = driver.newest.stamp_ns, speed_share(motion)
    with driver.recording(motion.name, about) as told:
        for step, speed in enumerate(motion.velocity):
            _follow(driver, motion, step, speed, share)
    driver.check_period(motion.name, motion.period_s, len(motion.position), began_ns)
    if not told:
        raise RefusedError(f"the bridge says nothing of the recording of {motion.name}")
    return Driven(
        name=motion.name,
        purpose=motion.purpose,
        kind=motion.kind,
        path=Path(told[0].path),
        reports=told[0].ticks,
    )


def speed_share(motion: Motion) -> float:
    """Returns the share of the robot's speed limits that a motion asks for."""
    limits = {joint.name: joint.velocity for joint in JOINTS}
    allowed = np.array([limits.get(name, np.inf) for name in motion.joint_names])
    needed = float((np.abs(motion.velocity) / allowed).max())
    return min(max(_ROOM * needed, _LEAST_SHARE), 1.0)


def _follow(driver: Driver, motion: Motion, step: int, speed: Array, share: float) -> None:
    """Commands one period of a motion."""
    behind = motion.position[step] - driver.newest.position
    values = motion.position[step]
    if motion.tracking is not None:
        slow = speed - driver.newest.velocity
        tracking = motion.tracking
        values = tracking.torque[step] + tracking.stiffness * behind + tracking.damping * slow
    elif motion.kind is CommandKind.VELOCITY:
        values = speed + _FEEDBACK * behind
    driver.command(motion.kind, motion.joint_names, values, speed_share=share)
