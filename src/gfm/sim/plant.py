"""A model with effects in it, ready to be asked what a recording should have looked like."""

from __future__ import annotations

import copy
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import CommandKind, ConfigError, UnknownNameError
from gfm.core.checks import Array
from gfm.effects import Effect, EffectInstance, find_effect
from gfm.effects.drive import LAGS
from gfm.effects.effect import MOTOR_SIDE, Compensation
from gfm.sim.step_laws import acts_at_every_step

#: Prefix of the sensors that a plant adds: the drive torque of each joint, and what to take off it.
DRIVE_SENSOR = "gfm_drive_"
#: MjsActuator.actdim of a drive without activation.
NO_ACTIVATION = -1


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A compiled model of some joints, with the effects that act outside MuJoCo.

    Attributes:
        model: Everything that MuJoCo expresses.
        joints: The joints that are commanded and measured, in order; J of them.
        qpos: Their addresses in qpos, shape (J,).
        dof: Their addresses in qvel, shape (J,).
        motor_qpos: Addresses of their motor sides in qpos, -1 where there is none, shape (J,).
        actuator: Their actuators, shape (J,).
        drive: Matrix from sensordata to the drive torque of each joint, shape (J, nsensordata).
        compensated: Whether the nominal model cancels gravity.
        effects: Every effect that was added, the delays and lags of the model itself among them.
    """

    model: mujoco.MjModel
    joints: tuple[str, ...]
    qpos: NDArray[np.intp]
    dof: NDArray[np.intp]
    motor_qpos: NDArray[np.intp]
    actuator: NDArray[np.intp]
    drive: NDArray[np.float64]
    compensated: bool = False
    effects: tuple[EffectInstance, ...] = field(default=())

    @property
    def stepwise(self) -> tuple[EffectInstance, ...]:
        """The effects that have to be evaluated at every step."""
        return tuple(e for e in self.effects if acts_at_every_step(e) or acts_on_servo(e))

    @property
    def servo_late_s(self) -> Array:
        """By how much later each drive feels its own motion, s, shape (J,)."""
        late_s = np.zeros(len(self.joints))
        for instance in self.effects:
            here = np.isin(self.joints, instance.joints)
            late_s += here * instance.effect.servo_late_s(instance.values)
        return late_s

    @property
    def effort_apart_s(self) -> float:
        """How much later than positions of the same stamp efforts were measured, s."""
        return sum(e.effect.effort_apart_s(e.values) for e in self.effects)

    @property
    def on_commands(self) -> tuple[Hashable, ...]:
        """What happens to commands: plants for which this is equal take the same ones."""
        acting = (e for e in self.effects if acts_on_command(e))
        return tuple((e.key, tuple(e.values.items())) for e in acting)

    @property
    def compensations(self) -> tuple[Compensation, ...]:
        """How the robot's gravity compensation errs; nothing where it has none."""
        return compensations(self.model, self.effects) if self.compensated else ()

    @property
    def layout(self) -> tuple[int, ...]:
        """Plants of the same layout can be simulated in one batch: their MjData are alike."""
        model = self.model
        moving = (model.nq, model.nv, model.na, model.nu, model.nM)
        return (*moving, model.nbody, model.ngeom, model.nbvh, model.nsensordata, model.ntendon)


def make_plant(
    spec: mujoco.MjSpec, joints: Sequence[str], effects: Sequence[EffectInstance] = ()
) -> Plant:
    """Returns `spec` (which stays as it is) with `effects` added.

    Effects on commands are left to the simulation, which can place them between two time steps;
    so are the delays and lags that the model has itself.

    Raises:
        UnknownNameError: the model lacks one of the joints, or an actuator of that name.
    """
    check_joints(spec, joints)
    changed = spec.copy()
    own = _taken_from_drives(changed, joints)
    for instance in in_order(effects):
        if not (instance.in_model or acts_on_command(instance)):
            instance.effect.apply(changed, instance.joints, instance.values)
    _add_drive_sensors(changed, joints)
    model = changed.compile()
    compensated = any(body.gravcomp for body in spec.bodies)
    return _plant(model, joints, compensated, (*own, *effects))


def _taken_from_drives(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[EffectInstance, ...]:
    """Takes delays and first-order lags out of the joints' drives; returns them as effects."""
    taken = []
    for name in joints:
        drive = spec.actuator(name)
        if drive.delay > 0.0:
            taken.append(_at(name, "command_delay", delay=float(drive.delay)))
            drive.delay, drive.nsample = 0.0, 0
        if drive.dyntype in LAGS:
            taken.append(_at(name, "actuator_lag", time_constant=float(drive.dynprm[0])))
            drive.dyntype, drive.actdim = mujoco.mjtDyn.mjDYN_NONE, NO_ACTIVATION
    return tuple(taken)


def _at(joint: str, name: str, **values: float) -> EffectInstance:
    return EffectInstance(effect=find_effect(name), joints=(joint,), values=values)


def compensations(
    model: mujoco.MjModel, effects: Sequence[EffectInstance]
) -> tuple[Compensation, ...]:
    """Returns how a gravity compensation errs under `effects`."""
    told = (e.effect.compensation(model, e.joints, e.values) for e in effects)
    return tuple(c for c in told if c is not None)


def in_order(effects: Sequence[EffectInstance]) -> list[EffectInstance]:
    """Returns `effects` in the order of application: what separates a motor from its link last.

    What stands on the motor's side has to be there before it is moved there.
    """
    return sorted(effects, key=lambda instance: instance.effect.separates_motor)


def acts_on_command(instance: EffectInstance) -> bool:
    """Returns whether an effect changes what is commanded rather than the model.

    By its law, not its amount: a fit may reach none at all, and plants must stay alike.
    """
    law = type(instance.effect)
    changes = law.lag_s is not Effect.lag_s or law.retime is not Effect.retime
    return changes and not instance.in_model


def acts_on_servo(instance: EffectInstance) -> bool:
    """Returns whether an effect makes drives late with all that they depend on: by its law, too."""
    return type(instance.effect).servo_late_s is not Effect.servo_late_s


def check_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Raises UnknownNameError for the first joint that lacks itself or its actuator in `spec`."""
    there = [joint.name for joint in spec.joints]
    driven = [actuator.name for actuator in spec.actuators]
    for name in joints:
        if name not in there:
            raise UnknownNameError("joint", name, there)
        if name not in driven:
            raise UnknownNameError("actuator", name, driven)


def _add_drive_sensors(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Adds what the drive torque of each joint is computed from.

    MuJoCo's actuator force at the joint and at its motor side, less what passive motors (friction,
    cogging) put there: those are not the drive.
    """
    there = {joint.name for joint in spec.joints}
    for name in joints:
        for side in (name, name + MOTOR_SIDE):
            if side in there:
                spec.add_sensor(
                    name=f"{DRIVE_SENSOR}plus_{side}",
                    type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                    objtype=mujoco.mjtObj.mjOBJ_JOINT,
                    objname=side,
                )
        for actuator in spec.actuators:
            if actuator.target in (name, name + MOTOR_SIDE) and actuator.name != name:
                spec.add_sensor(
                    name=f"{DRIVE_SENSOR}minus_{name}:{actuator.name}",
                    type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
                    objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
                    objname=actuator.name,
                )


def _plant(
    model: mujoco.MjModel,
    joints: Sequence[str],
    compensated: bool,
    effects: tuple[EffectInstance, ...],
) -> Plant:
    ids = [model.joint(name).id for name in joints]
    motors = [
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name + MOTOR_SIDE) for name in joints
    ]
    return Plant(
        model=model,
        joints=tuple(joints),
        qpos=np.array([model.jnt_qposadr[i] for i in ids]),
        dof=np.array([model.jnt_dofadr[i] for i in ids]),
        motor_qpos=np.array([model.jnt_qposadr[i] if i >= 0 else -1 for i in motors]),
        actuator=np.array([model.actuator(name).id for name in joints]),
        drive=drive_matrix(model, joints),
        compensated=compensated,
        effects=effects,
    )


def drive_matrix(model: mujoco.MjModel, joints: Sequence[str]) -> NDArray[np.float64]:
    """Returns the matrix from sensor data to the drive torque of each joint, shape (J, M)."""
    matrix = np.zeros((len(joints), model.nsensordata))
    for row, name in enumerate(joints):
        for side in (name, name + MOTOR_SIDE):
            _mark(model, matrix[row], f"{DRIVE_SENSOR}plus_{side}", 1.0)
        for index in range(model.nactuator):
            beside = model.actuator(index).name
            _mark(model, matrix[row], f"{DRIVE_SENSOR}minus_{name}:{beside}", -1.0)
    return matrix


def drive_dofs(model: mujoco.MjModel, joints: Sequence[str]) -> NDArray[np.intp]:
    """Returns where the drive of each joint acts in qvel: on the motor's side, (J,)."""
    sides = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, n + MOTOR_SIDE) for n in joints)
    links = (model.joint(name).id for name in joints)
    ids = [link if side < 0 else side for side, link in zip(sides, links, strict=True)]
    return np.asarray(model.jnt_dofadr[ids], np.intp)


def _mark(model: mujoco.MjModel, row: NDArray[np.float64], sensor: str, weight: float) -> None:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, sensor)
    if index >= 0:
        row[model.sensor_adr[index]] += weight


def native_spec(spec: mujoco.MjSpec, effects: Sequence[EffectInstance]) -> mujoco.MjSpec:
    """Returns a copy of `spec` with every effect that plain MuJoCo expresses, commands included."""
    changed = spec.copy()
    for instance in in_order([e for e in effects if e.effect.native and not e.in_model]):
        instance.effect.apply(changed, instance.joints, instance.values)
    return changed


def stepping_spec(spec: mujoco.MjSpec, effects: Sequence[EffectInstance]) -> mujoco.MjSpec:
    """Returns a copy of `spec` with all that MuJoCo expresses of `effects`, commands included.

    What is left of them is up to who steps it (`gfm.sim.batch`). Where that is dry friction which
    depends on the drive, sensors tell the torque of every drive. What is late in the channels of
    sensors and in the feedback of servos is left out (`Effect.not_stepped`).

    Raises:
        ConfigError: an effect changes commands in a way that MuJoCo cannot express.
    """
    changed = spec.copy()
    for instance in in_order([e for e in effects if not e.in_model]):
        known = instance.effect.native or instance.effect.not_stepped is not None
        if acts_on_command(instance) and not known:
            raise ConfigError(
                f"{instance.effect.name} changes commands in a way that MuJoCo cannot express: "
                "recordings can be predicted with it, simulations cannot be stepped"
            )
        instance.effect.apply(changed, instance.joints, instance.values)
    if any(acts_at_every_step(e) for e in effects):
        driven = {actuator.name for actuator in changed.actuators}
        _add_drive_sensors(changed, [j.name for j in changed.joints if j.name in driven])
    return changed


def with_servo_gain(
    model: mujoco.MjModel, actuator: NDArray[np.intp], kind: CommandKind, gain: NDArray[np.float64]
) -> mujoco.MjModel:
    """Returns the model with servo gains multiplied, itself where there is nothing to do.

    Position servos: the stiffness, not the damping. Velocity servos: the velocity gain. Motors:
    the gain. A gain of zero is a drive that is switched off: it does not damp either.

    Args:
        model: In which a gain is one.
        actuator: The servos, shape (J,).
        kind: What they follow.
        gain: Factor of each, shape (J,).
    """
    if (gain == 1.0).all():
        return model
    changed = copy.copy(model)
    feedback = {CommandKind.POSITION: 1, CommandKind.VELOCITY: 2, CommandKind.EFFORT: 0}[kind]
    changed.actuator_gainprm[actuator, 0] *= gain
    changed.actuator_biasprm[actuator, feedback] *= gain
    changed.actuator_biasprm[actuator] *= (gain > 0.0)[:, None]
    return changed
