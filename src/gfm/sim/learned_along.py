"""The forces that a fitted force model exerts along a recorded motion, without stepping.

Shape letters: T measurements, J joints, K control periods, H earlier states, F forces.
"""

from __future__ import annotations

import numpy as np

from gfm.core import ConfigError, Trajectory
from gfm.core.checks import Array, Array32
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import LearnedForces
from gfm.sim.replay import Replay, make_replay


def check_robot(forces: LearnedForces, joints: tuple[str, ...]) -> None:
    """Raises ConfigError where a force model was fitted to another robot than has these joints."""
    if set(forces.joint_names) != set(joints):
        raise ConfigError(
            f"force model of another robot: it observes {', '.join(forces.joint_names)}; "
            f"recorded are {', '.join(joints)}"
        )


def joint_forces_along(forces: LearnedForces, model: HybridModel, trajectory: Trajectory) -> Array:
    """Returns a force model's forces on the joints at the measurements, N m, shape (T, J).

    It decides once per control period from what it would have observed, and its forces are held; as
    long as its history is not full, the first decision counts. Joints in the recording's order.

    Args:
        forces: The force model.
        model: What it was fitted on, with its control period.
        trajectory: Whose motion is looked at.

    Raises:
        BadInputError: force model, model and recording do not belong together.
    """
    check_robot(forces, trajectory.joint_names)
    replay = make_replay(model, trajectory)
    decided = _decisions(forces, replay)
    history = forces.features.history
    period = np.floor((trajectory.time_s - replay.start_s) / model.control_period_s).astype(int)
    held = decided[np.clip(period - history, 0, len(decided) - 1)]
    told = np.zeros((len(held), len(trajectory.joint_names)))
    for column, name in enumerate(forces.forced_joints):
        told[:, trajectory.joint_names.index(name)] = held[:, column]
    return told


def _decisions(forces: LearnedForces, replay: Replay) -> Array:
    """Returns the forces of every control period that has a whole history, shape (K - H, F)."""
    layout, features = forces.layout_in(replay.model), forces.features
    now = np.arange(features.history, replay.periods)
    if not len(now):
        raise ConfigError(
            f"{replay.name}: {replay.periods} control periods; the force model looks back "
            f"{features.history}"
        )
    states = features.state(layout, replay.qpos, replay.qvel)
    observation: Array32 = np.zeros((len(now), features.size), np.float32)
    features.fill(observation, states[now[:, None] + np.arange(-features.history, 1)])
    q, v = replay.qpos[now][:, layout.qpos], replay.qvel[now][:, layout.dof]
    torque = drive_torque(drive_law(replay.model, layout), replay.command[now, 0], q, v)
    features.put_torque(observation, torque)
    return np.asarray(forces.policy.mean_action(observation) * forces.force_limit)
