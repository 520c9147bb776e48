"""mujoco.sysid 4.0 with all its parameters at once, as its documentation shows it.

It names the parameter that matters most: that whose return to nominal costs most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeAlias

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.commands import stepping_commands
from gfm.sim.plant import make_plant
from gfm.sim.segment import Segment
from peers.case import Case, Named, rises

#: Loaded by name: its types would be all that is known of MuJoCo's.
sysid = import_module("mujoco.sysid")
Parameter: TypeAlias = Any
ParameterDict: TypeAlias = Any
ModelSequences: TypeAlias = Any
TimeSeries: TypeAlias = Any
#: Recorded time in its rollouts, s, and steps of its optimizer.
_SIMULATED_S, _STEPS = 8.0, 25
_DELAY = 0.04


def toolbox(case: Case) -> tuple[list[Named], float]:
    """Returns what matters most of the parameters found, and the held-out error."""
    knobs, parameters = _knobs(case), sysid.ParameterDict()
    for name, knob in knobs.items():
        parameters.add(knob.parameter(name))
    transform = sysid.SignalTransform()
    transform.delay("*", parameters["delay"])
    sequences = [_sequences(case, kind) for kind in case.specs]
    residual = sysid.build_residual_fn(
        models_sequences=sequences,
        # Each set of parameters changes the model as it was given.
        build_model=lambda p, spec: sysid.apply_param_modifiers(p, spec.copy()),
        modify_residual=transform.apply,
        n_threads=1,
    )
    found, _ = sysid.optimize(parameters, residual, verbose=False, max_iters=_STEPS)
    x, nominal = found.as_vector(), found.as_nominal_vector()

    def cost(vector: Array) -> float:
        return float(np.sum(np.concatenate(residual(vector, found)[0]) ** 2))

    returned = [np.where(np.arange(len(x)) == i, nominal, x) for i in range(len(x))]
    losses = rises(np.array([cost(r) for r in returned]), cost(x))
    most = int(np.argmax(losses))
    knob = list(knobs.values())[most]
    said = knob.say(float(x[most]))
    named = Named(effect=knob.effect, joints=knob.joints, parameters=said, weight=1.0)
    return [named], _after(case, found, x)


@dataclass(frozen=True, kw_only=True)
class Knob:
    """A number that sysid turns.

    Attributes:
        effect: What it is in the words of the vocabulary.
        joints: On which joints.
        start: Its nominal value.
        bounds: In which it is looked for.
        say: What a value says of the effect's parameters.
        act: Puts a value into a model.
    """

    effect: str
    joints: tuple[str, ...]
    start: float = 0.0
    bounds: tuple[float, float]
    say: Callable[[float], dict[str, float]]
    act: Callable[[mujoco.MjSpec, float], None] | None

    def parameter(self, name: str) -> Parameter:
        """Returns it as sysid has it."""
        act = self.act

        def modify(spec: mujoco.MjSpec, parameter: Parameter) -> None:
            if act is not None:
                act(spec, float(parameter.value[0]))

        return sysid.Parameter(name, self.start, *self.bounds, modifier=modify)


def _knobs(case: Case) -> dict[str, Knob]:
    """Returns everything that is turned, by name."""
    spec = next(iter(case.specs.values()))
    knobs: dict[str, Knob] = {}
    for name in case.joints:
        joint = spec.joint(name)
        knobs |= _joint_knobs(name, float(joint.armature), float(joint.damping[0]))
    last, mass = case.joints[-1], float(spec.joint(case.joints[-1]).parent.mass)

    def load(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(last).parent.mass += value

    knobs["mass"] = Knob(
        effect="payload", joints=(last,), bounds=(0.0, 3 * mass), say=_as("mass"), act=load
    )
    knobs["delay"] = Knob(
        effect="command_delay",
        joints=case.joints,
        bounds=(-0.005, _DELAY),
        say=_as("delay"),
        act=None,
    )
    return knobs


def _joint_knobs(name: str, armature: float, damping: float) -> dict[str, Knob]:
    """Returns what is turned on one joint."""
    inertia, drag = max(armature, 1e-3), max(damping, 0.01)

    def add_armature(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(name).armature += value

    def add_damping(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(name).damping[0] += value

    def add_friction(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(name).frictionloss += value

    def add_stiffness(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(name).stiffness[0] += value

    def scale_drive(spec: mujoco.MjSpec, value: float) -> None:
        drive = spec.actuator(name)
        drive.gainprm = np.asarray(drive.gainprm) * value
        drive.biasprm = np.asarray(drive.biasprm) * value

    def shift_zero(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint(name).ref += value

    rows = (
        ("armature", "inertia", 0.0, (0.0, 10 * inertia), add_armature),
        ("viscous_friction", "coefficient", 0.0, (0.0, 50 * drag), add_damping),
        ("coulomb_friction", "torque", 0.0, (0.0, 50 * drag), add_friction),
        ("joint_spring", "stiffness", 0.0, (0.0, 100 * drag), add_stiffness),
        ("actuator_gain", "scale", 1.0, (0.2, 3.0), scale_drive),
        ("encoder_offset", "offset", 0.0, (-0.2, 0.2), shift_zero),
    )
    return {
        f"{name}_{effect}": Knob(
            effect=effect, joints=(name,), start=start, bounds=bounds, say=_as(number), act=act
        )
        for effect, number, start, bounds, act in rows
    }


def _as(name: str) -> Callable[[float], dict[str, float]]:
    return lambda value: {name: value}


def _sequences(case: Case, kind: CommandKind) -> ModelSequences:
    """Returns the training rollouts of one kind for sysid: joint sensors, held commands."""
    spec = case.specs[kind].copy()
    for name in case.joints:
        spec.add_sensor(
            name=f"{name}_pos",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
    model = spec.compile()
    problem = case.problem.subset(case.problem.sample(_SIMULATED_S))
    segments = [s for s in problem.segments if s.kind is kind]
    series = [_series(case, kind, model, segment) for segment in segments]
    return sysid.ModelSequences(
        str(kind),
        spec,
        [f"{kind}_{i}" for i in range(len(series))],
        [one[0] for one in series],
        [one[1] for one in series],
        [one[2] for one in series],
    )


def _series(
    case: Case, kind: CommandKind, model: mujoco.MjModel, segment: Segment
) -> tuple[Array, TimeSeries, TimeSeries]:
    """Returns initial state, commands and positions of one rollout."""
    steps = int(segment.time_s[-1] / model.opt.timestep) + 2
    plant = make_plant(case.specs[kind], case.joints)
    times = model.opt.timestep * np.arange(steps)
    control = np.zeros((steps, model.nu))
    control[:, plant.actuator] = stepping_commands(plant, segment, steps)
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    qpos[plant.qpos], qvel[plant.dof] = segment.initial_position, segment.initial_velocity
    start = sysid.create_initial_state(model, qpos, qvel)
    names = [f"{name}_pos" for name in case.joints]
    return (
        start,
        sysid.TimeSeries.from_control_names(times, control, model),
        sysid.TimeSeries.from_names(segment.time_s, segment.position, model, names),
    )


def _after(case: Case, found: ParameterDict, x: Array) -> float:
    """Returns the held-out error of the model that sysid made."""
    found.update_from_vector(x)
    specs = {}
    for kind, spec in case.specs.items():
        specs[kind] = sysid.apply_param_modifiers_spec(found, spec.copy())
    delay = {"delay": max(float(found["delay"].value[0]), 0.0)}
    late = Named(effect="command_delay", joints=case.joints, parameters=delay, weight=0.0)
    instance = late.instance
    return case.held_out_error(specs, () if instance is None else (instance,))
