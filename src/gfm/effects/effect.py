"""The port of every named effect: parameters with units and bounds, and how it acts in a model.

An effect changes a model in one or more of these ways, and the simulation of a recording
(`gfm.sim.plant`) asks for each of them:

* `apply` edits an MjSpec: everything that MuJoCo can express natively;
* `retime` and `lag_s` transform what is commanded before the model sees it;
* `servo_late_s` makes a drive's torque late with all that it depends on;
* `effort_apart_s` says that efforts were measured at other times than positions of their stamps;
* `extra_friction` is a level that MuJoCo cannot express and that is therefore set at every step;
* `torque` is, where `stepwise` says so, put on the joint at every step, for the same reason;
* `drive_change` is what a drive gives beside its model's torque, also told at every step;
* `compensation` says how a controller that cancels gravity errs under it.

Amounts are always *added* to what the model already has.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar, TypeAlias

import mujoco
import numpy as np

from gfm.core.checks import Array

Values = Mapping[str, float]

#: Suffix of the joint that carries a motor's side: armature, friction and drive.
MOTOR_SIDE = "_motor"


class Scope(StrEnum):
    """On what an effect acts, and so how many joints it names."""

    JOINT = "joint"
    PAIR = "pair"
    LAST = "last joint"
    ROBOT = "robot"
    OBJECT = "object"


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of an effect: its unit and the range in which it is looked for.

    What is smaller than `least` is none: no stamp and no controller's cycle is as exact. What
    `takes_off` may be less than `lower`, where a model has more of it than its robot. `rough_below`
    is the share of itself over which derivatives by it are taken: what a smaller change does is
    chance, where a motion is made of impacts.
    """

    name: str
    unit: str
    lower: float
    upper: float
    least: float = 0.0
    takes_off: bool = False
    rough_below: float = 0.01


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Typical sizes of one joint's signals, from which probes are sized.

    Attributes:
        torque_nm: RMS of the drive torque.
        excess_nm: RMS of the torque that the nominal model does not explain.
        velocity_rad_s: RMS of the velocity.
        position_rad: Half the range covered.
        peak_nm: Largest torque that the motion takes, by inverse dynamics: a servo model without
            its limit would ask for far more.
        servo_nm: The same without what a gravity compensation gives, as measured where it was.
        inertia: Of the joint with everything behind it, kg m^2.
        cogging_per_revolution: Orders that stand out in the unexplained torque over the angle.
        lowest_m: Of the last joint: points of its link, in the link's frame, and how low each came
            in the world, as x, y, z, height.
    """

    torque_nm: float
    excess_nm: float
    velocity_rad_s: float
    position_rad: float
    peak_nm: float
    servo_nm: float
    inertia: float
    cogging_per_revolution: tuple[int, ...] = ()
    lowest_m: tuple[tuple[float, float, float, float], ...] = ()


#: The state of a joint that its drive should give a torque.
DRIVE = "drive torque"


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One joint's signals, shape (T,) each: along a motion, or at one moment of many simulations.

    `drive` is the actuator's torque; `other_velocity` that of the second joint of a pair.
    """

    position: Array
    velocity: Array
    drive: Array
    other_velocity: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Compensation:
    """In what a controller's gravity compensation differs from MuJoCo's own, under some effect.

    A controller compensates for the gravity that it believes in, at the *reported* position; MuJoCo
    for the gravity that there is, at the true one. Both bear the same bodies.

    Attributes:
        gravity: In which the controller believes, m/s^2, shape (3,); None for that of the model.
        shift: What it adds to qpos, shape (nq,); None for nothing.
        moved: Degrees of freedom of a link and of its motor side: a drive's compensation acts on
            the motor, MuJoCo's on the link.
    """

    gravity: Array | None = None
    shift: Array | None = None
    moved: tuple[int, int] | None = None


@dataclass(frozen=True, kw_only=True)
class Shift:
    """How a delay moves what was recorded against the commands, in units of the delay.

    Recordings tell two delays apart by this alone: where they move alike what was recorded, they
    are one and the same under two names.

    Attributes:
        positions: By how much later than commanded positions are reported.
        efforts: By how much later than commanded efforts are reported.
        feedback: Whether a servo's feedback is late, too: where there is feedback, that is a law of
            its own, and no shift.
    """

    positions: float
    efforts: float
    feedback: bool = False


#: Probes of one effect at one place: a group of parameter values whose responses span, to first
#: order, all that the effect can do near nothing.
ProbeGroup = Sequence[Values]


class Effect(ABC):
    """One physical law that a model may lack. Stateless: parameters come in with every call."""

    name: ClassVar[str]
    scope: ClassVar[Scope] = Scope.JOINT
    parameters: ClassVar[tuple[Parameter, ...]]
    #: Whether plain MuJoCo expresses it.
    native: ClassVar[bool] = True
    #: Whether `torque` is to be put on the joint at every step, for MuJoCo cannot express it.
    stepwise: ClassVar[bool] = False
    #: Whether it stands between the motor (armature, friction, drive) and the link.
    separates_motor: ClassVar[bool] = False
    #: Whether that is a spring, behind which the motor rings.
    rings: ClassVar[bool] = False
    #: Whether links are elsewhere than joints report.
    displaces: ClassVar[bool] = False
    #: Whether it acts on a drive: joints without one cannot have it.
    needs_drive: ClassVar[bool] = False
    #: Whether simulating it takes so long that simpler explanations are tried first.
    costly: ClassVar[bool] = False
    #: Whether it acts now and then only: looked for in the segments that nothing else explains.
    #: Few segments tell of it: its amounts are given without intervals.
    intermittent: ClassVar[bool] = False
    #: Whether its law has a kink or a jump: simulators soften those and samples fall beside them;
    #: where it is what was missing, a little more than noise may be left.
    abrupt: ClassVar[bool] = False
    #: Of an effect of the robot: whether it names the joints that share it.
    shares_joints: ClassVar[bool] = False
    #: Parameters that a fit leaves as the search found them.
    fixed: ClassVar[tuple[str, ...]] = ()
    #: Parameters in which a fit ends in the valley where it starts: every probe's is a start.
    valleys: ClassVar[tuple[str, ...]] = ()
    #: Whether fits of it end beside the truth, for it holds joints and small changes tell nothing:
    #: where they begin is looked for with rollouts.
    rugged: ClassVar[bool] = False
    #: The effect above whose level it comes: alone it would be fitted to stand for both.
    excess_of: ClassVar[str | None] = None
    #: The motion that shows it, in words.
    shown_by: ClassVar[str]
    #: Over which signal of `Motion` the report draws its law: velocity, position or drive (over the
    #: size of the drive torque, against the motion).
    seen_over: ClassVar[str] = "velocity"
    #: The one state of its joint of which its torque is a law, "position", "velocity" or `DRIVE`;
    #: None where there is none, or more than that. Several laws of one state are one law.
    law_of: ClassVar[str | None] = None
    #: Effects that look like it in many motions: they are always put beside it.
    confused_with: ClassVar[tuple[str, ...]] = ()
    #: The effect whose law it is under another name, if there is one: only that is looked for.
    twin: ClassVar[str | None] = None
    #: Of a delay: what it moves, and so which other delays it is in which recordings.
    shift: ClassVar[Shift | None] = None
    #: What stepped simulations leave out of it, in words, if that is known and no error.
    not_stepped: ClassVar[str | None] = None

    @property
    def how_much(self) -> tuple[str, ...]:
        """Its parameters that say how much of it there is: the first, and others in its unit.

        None where no such amount is nothing (a limit, a stiffness behind a motor, a gain), and of
        what acts now and then, which is somewhere.
        """
        first = self.parameters[0]
        if self.intermittent or not first.lower <= 0.0 <= first.upper:
            return ()
        return tuple(p.name for p in self.parameters if p.unit == first.unit)

    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:  # noqa: B027
        """Adds the effect to `spec` in place. Nothing by default."""

    def retime(self, time_s: Array, values: Values) -> Array:
        """Returns when commands issued at `time_s` arrive at the drive, shape (C,). At once."""
        del values
        return time_s

    def lag_s(self, values: Values) -> float:
        """Returns the time constant with which the drive follows its command. Zero by default."""
        del values
        return 0.0

    def servo_late_s(self, values: Values) -> float:
        """Returns by how much later the drive feels its own motion. At once by default."""
        del values
        return 0.0

    def effort_apart_s(self, values: Values) -> float:
        """Returns how much later than positions of the same stamp efforts were measured, s."""
        del values
        return 0.0

    def extra_friction(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        """Returns the dry friction to add at this moment, N m, shape (N,); None for none.

        Args:
            motion: The joint in N simulations.
            values: Each parameter, shape (N,).
        """
        del motion, values
        return None

    def drive_change(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        """Returns what the drive gives beside its model's torque now, N m, shape (N,).

        None for nothing. Efforts are measured with it.

        Args:
            motion: The joint in N simulations, its drive as in the model.
            values: Each parameter, shape (N,).
        """
        del motion, values
        return None

    def compensation(
        self, model: mujoco.MjModel, joints: Sequence[str], values: Values
    ) -> Compensation | None:
        """Returns how a gravity compensation errs under this effect; None where it does not."""
        del model, joints, values
        return None

    @abstractmethod
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        """Returns groups of small amounts with which to ask a recording about the effect."""

    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        """Returns the parameters that respond like the weighted sum of a group's responses.

        By default a group has one member and the weight multiplies its first parameter. None where
        no admissible parameters do (a negative friction, say).
        """
        values = dict(group[0])
        first = self.parameters[0].name
        values[first] *= amplitudes[0]
        return values if self.admissible(values) else None

    def admissible(self, values: Values) -> bool:
        """Returns whether every parameter is finite and within its bounds."""
        return all(p.lower <= values[p.name] <= p.upper for p in self.parameters)

    def possible(self, values: Values) -> bool:
        """Returns whether a robot may differ from its model by so much."""
        lowest = {p.name: -p.upper if p.takes_off else p.lower for p in self.parameters}
        return all(lowest[p.name] <= values[p.name] <= p.upper for p in self.parameters)

    def canonical(self, values: Values) -> Values:
        """Returns the same amounts written in the one usual way: angles within a turn."""
        return values

    def torque(self, motion: Motion, values: Values) -> Array | None:
        """Returns the generalized force on the (first) joint along a motion, shape (T,), N m.

        None where the effect is not a force of position, velocity and drive. Of a `stepwise` effect
        values may be arrays, shape (T,): one for each simulation.
        """
        del motion, values
        return None


_ZERO = np.zeros(1)
#: A joint at rest that nothing drives, to ask whether there is a law.
AT_REST = Motion(position=_ZERO, velocity=_ZERO, drive=_ZERO, other_velocity=_ZERO)

#: An effect, by its name, and the joints on which it acts.
Key: TypeAlias = tuple[str, tuple[str, ...]]


@dataclass(frozen=True)
class Placed:
    """What is said of an effect somewhere: made of its `key`, and what else is said.

    Attributes:
        effect: Name in the effect library.
        joints: Where it acts; empty for an effect of the whole robot.
    """

    effect: str
    joints: tuple[str, ...]

    @property
    def key(self) -> Key:
        """What makes it the same effect in the same place."""
        return self.effect, self.joints


@dataclass(frozen=True, kw_only=True)
class EffectInstance:
    """An effect somewhere, in some amount.

    Attributes:
        effect: The law.
        joints: Where it acts.
        values: Its amounts.
        in_model: Whether the model has what MuJoCo expresses of it already, and only the rest (how
            it misleads a gravity compensation, say) is to be added.
        least: Amounts to which a fit looks, where its parameter does not allow for as little: by so
            much the model may have too much of it.
        most: Sizes, to either side, up to which a fit looks, where its parameter allows for more.
    """

    effect: Effect
    joints: tuple[str, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    in_model: bool = False
    least: Mapping[str, float] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> Key:
        """What makes two instances the same effect in the same place."""
        return self.effect.name, self.joints

    @property
    def takes_off(self) -> bool:
        """Whether less than nothing is added: the model has more of it than its robot."""
        return any(p.takes_off and self.values[p.name] < 0.0 for p in self.effect.parameters)

    @property
    def has_law(self) -> bool:
        """Whether it is a force of position, velocity and drive, which `Effect.torque` tells."""
        return bool(self.joints) and self.effect.torque(AT_REST, self.values) is not None

    @property
    def in_closed_form(self) -> bool:
        """Whether the torque that it adds is told by `added`."""
        return bool(self.joints) and self.added(AT_REST) is not None

    def added(self, motion: Motion) -> Array | None:
        """Returns the torque that it adds on its (first) joint along a motion, shape (T,), N m.

        Its law, or what a drive gives beside its model's torque; None where it is neither.
        """
        law = self.effect.torque(motion, self.values)
        if law is not None:
            return law
        return self.effect.drive_change(motion, {k: np.array(v) for k, v in self.values.items()})


def angle(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, value: float) -> float:
    """Returns a joint angle in the unit in which `spec` is written (degrees by default in MJCF)."""
    hinge = joint.type == mujoco.mjtJoint.mjJNT_HINGE
    return math.degrees(value) if hinge and spec.compiler.degree else value


def find_joint(spec: mujoco.MjSpec, name: str) -> mujoco.MjsJoint:
    """Returns the joint called `name`."""
    return spec.joint(name)


def find_motor_side(spec: mujoco.MjSpec, name: str) -> mujoco.MjsJoint:
    """Returns the joint of the motor's side, where the model has one apart from the link's.

    Armature, friction and drive are there.
    """
    return spec.joint(name + MOTOR_SIDE) or find_joint(spec, name)


def free_name(taken: Iterable[object], name: str) -> str:
    """Returns `name`, with a number behind it where one of `taken` is called so."""
    names = {getattr(one, "name", "") for one in taken}
    others = (f"{name}_{number}" for number in itertools.count(2))
    return next(one for one in itertools.chain([name], others) if one not in names)


def find_actuator(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsActuator:
    """Returns the actuator that drives `joint`: by contract it has the joint's name."""
    return spec.actuator(joint)


def sign(velocity: Array, width: float) -> Array:
    """Returns a sign that passes through zero over about `width`: for measured velocities."""
    return np.asarray(np.tanh(velocity / width))
