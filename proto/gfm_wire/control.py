"""The small messages that ask, acknowledge and refuse; values of `gfm.core` carry the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from gfm.core import Command, EnvironmentSpec, Observation
from gfm.core.checks import Array, Array32, check_shapes

#: How the reason of a refusal begins where a bridge stopped the arm by itself, for what the arm did
#: and not for what somebody said: its driver may begin again.
PROTECTIVE_STOP = "protective stop: "
#: What an arm of this size may carry, kg, and how far from its last link's frame, m.
_HEAVIEST_KG, _FARTHEST_M = 4.0, 0.5


@dataclass(frozen=True, kw_only=True)
class Ack:
    """Done; there is nothing more to say."""


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """No.

    Attributes:
        reason: Why, in words that a person can act on.
    """

    reason: str


@dataclass(frozen=True, kw_only=True)
class NotReady:
    """Not yet: ask again later.

    Attributes:
        reason: What is being waited for, in words.
        inserted: Sequences that have been accepted so far.
        needed: Sequences that must have been accepted before the answer is yes.
    """

    reason: str
    inserted: int = 0
    needed: int = 0


@dataclass(frozen=True, kw_only=True)
class SequenceAck:
    """What the replay service has from one life of one actor.

    Attributes:
        actor: Sequence.actor of the acknowledged sequence.
        epoch: Sequence.epoch of the acknowledged sequence.
        number: Sequence.number of the acknowledged sequence.
        cursor: No sequence with a number below this one is waited for: it has arrived, or was given
            up; never goes backwards.
    """

    actor: str
    epoch: int
    number: int
    cursor: int


@dataclass(frozen=True, kw_only=True)
class SampleRequest:
    """Asks the replay service for a batch.

    Attributes:
        batch_size: Sequences wanted, at least 1.
        spec_digest: EnvironmentSpec.digest that the asker learns for; empty takes any.
        seen: Batch.index of sequences that it learned from lately, shape (K,).
        priority: By how much it errs about each of them, at least 0, shape (K,).
    """

    batch_size: int
    spec_digest: str = ""
    seen: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    priority: Array32 = field(default_factory=lambda: np.empty(0, np.float32))

    def __post_init__(self) -> None:
        check_shapes(vars(self), {"priority": self.seen.shape})


@dataclass(frozen=True, kw_only=True)
class WeightsRequest:
    """Asks the learner for its current weights: how late joiners catch up.

    Attributes:
        spec_digest: EnvironmentSpec.digest that the asker acts in; empty takes any.
        settings: Every setting of it by name, in words, with digests in the place of files
            (`gfm.service.environment_words`); empty takes any.
    """

    spec_digest: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class EnvironmentRequest:
    """Asks the learner which environment the run learns for: nobody else need be told.

    Attributes:
        name: Registered name of the environment that the asker wants to act in; empty takes any.
    """

    name: str


@dataclass(frozen=True, kw_only=True)
class RunEnvironment:
    """The environment that a run learns for.

    Attributes:
        name: Its registered name.
        settings: `gfm.envs.registry.EnvironmentSettings` as JSON; files by their absolute paths as
            the learner sees them.
        spec: Its sizes, and the ranges that its values are within.
    """

    name: str
    settings: str
    spec: EnvironmentSpec


@dataclass(frozen=True, kw_only=True)
class StatusRequest:
    """Asks a service how it is."""


@dataclass(frozen=True, kw_only=True)
class RecordStart:
    """Asks the robot bridge to begin a recording.

    Attributes:
        name: The recording's name; not a path: the bridge alone knows its folder.
        metadata: Whatever else the file shall say about itself.
    """

    name: str
    metadata: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RecordStop:
    """Asks the robot bridge to finish the recording that is under way."""


@dataclass(frozen=True, kw_only=True)
class RecordDone:
    """A recording that lies finished on the bridge's disk.

    Attributes:
        path: Where the file is, as seen by the bridge.
        ticks: Observations in it.
    """

    path: str
    ticks: int


@dataclass(frozen=True, kw_only=True)
class PlaceObject:
    """Asks for the free object to be put somewhere, at rest: what a person does at a real robot.

    Attributes:
        pose: Base frame, m and quaternion w x y z, shape (7,).
    """

    pose: Array

    def __post_init__(self) -> None:
        check_shapes({"pose": self.pose}, {"pose": (7,)})


@dataclass(frozen=True, kw_only=True)
class SetPayload:
    """Tells the robot what its last link carries, for its gravity compensation to bear.

    In place of what it was told before; a mass of 0 takes that back.

    Attributes:
        mass_kg: Of the load.
        com_m: Its centre of mass, m, in the frame of the last link, shape (3,).
    """

    mass_kg: float
    com_m: Array

    def __post_init__(self) -> None:
        check_shapes({"com_m": self.com_m}, {"com_m": (3,)})

    @property
    def problem(self) -> str:
        """Why no arm of this size carries that, in words; empty where one may."""
        if not 0.0 <= self.mass_kg <= _HEAVIEST_KG:
            return f"payload has a mass of {self.mass_kg:g} kg, expected 0 to {_HEAVIEST_KG:g} kg"
        away_m = float(np.linalg.norm(self.com_m))
        if away_m <= _FARTHEST_M:
            return ""
        return (
            f"payload has its centre {away_m:.3g} m from the last link, "
            f"expected at most {_FARTHEST_M:g} m"
        )

    def __str__(self) -> str:
        x, y, z = (f"{value:.4g}" for value in self.com_m)
        return f"{self.mass_kg:.4g} kg at {x}, {y}, {z} m"


@dataclass(frozen=True, kw_only=True)
class ByHand:
    """The robot cannot do that: a person has to."""


@dataclass(frozen=True, kw_only=True)
class ReleaseRobot:
    """Tells the robot bridge that its driver lets go: somebody else may drive from now on."""


@dataclass(frozen=True, kw_only=True)
class StopRobot:
    """Tells the robot bridge to stop the robot: its driver has to begin again.

    Attributes:
        reason: Why, for whoever drives.
    """

    reason: str


@dataclass(frozen=True, kw_only=True)
class ScaleSpeed:
    """Tells the robot bridge at which part of the commanded speed to go.

    Attributes:
        scale: 0 to 1; 0 is a soft stop, after which the driver may go on.
    """

    scale: float


class PowerAction(StrEnum):
    """What is done to a robot's drives: only a person says so."""

    ENABLE = "enable"
    DISABLE = "disable"
    STOP = "estop"
    RESET = "reset"


@dataclass(frozen=True, kw_only=True)
class PowerRobot:
    """Tells the robot bridge to switch the robot's drives, or to clear a fault.

    Attributes:
        action: estop: as the e-stop button does. reset: clears a stop or an error.
    """

    action: PowerAction


class RobotClock(StrEnum):
    """How a robot's time passes: by itself, or only as exchanges ask for it."""

    WALL = "wall"
    LOCKSTEP = "lockstep"


@dataclass(frozen=True, kw_only=True)
class RobotExchange:
    """Tells the simulated robot what to do, and for how long.

    Attributes:
        commands: What to do from the time on that each is stamped with, oldest first; none leave
            what is in force.
        advance_ns: Robot time to pass before the answer, at least 0.
        object_pose: Where to put the object before that, as in PlaceObject; None leaves it.
        payload: What the arm carries, from then on; None leaves what was told before.
        clock: How the bridge believes that the robot's time passes; another belief is refused.
    """

    commands: tuple[Command, ...]
    advance_ns: int
    object_pose: Array | None = None
    payload: SetPayload | None = None
    clock: RobotClock = RobotClock.WALL

    def __post_init__(self) -> None:
        check_shapes({"object_pose": self.object_pose}, {"object_pose": (7,)})


@dataclass(frozen=True, kw_only=True)
class RobotStates:
    """What the simulated robot's sensors reported in the time that passed.

    Attributes:
        states: Oldest first; the last is the current one.
    """

    states: tuple[Observation, ...]
