"""What the nominal arm would do of what it is told, and how it would come to rest.

Shape letters: J joints, N moments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm_robot_bridge.plan import Plan, smaller

#: Steps in which it is looked ahead, s: the drives' time constants are 20 ms and more.
_STEP_S = 0.005
#: How long an arm moves on when the setpoint of its speed has come to rest, s: its servos lag ...
_SETTLES_S = 0.15
#: .. and when the setpoint of its position has, s.
_ARRIVES_S = 0.3
#: How long at most a loaded arm stands at speeds of 0, s, before it holds its position: the robot's
#: own stop waits so long.
_SINKS_S = 0.2


@final
class Foresight:
    """Steps the nominal model ahead: links, motors and servos, without contacts.

    Args:
        models: With drives that take commands of each kind; the joints are the arm's, in order.
        braking: Of a stop, rad/s^2, shape (J,).
        slowing: Of one in position mode, rad/s^2, shape (J,).
        next_s: In which time the bridge can stop it, after what it is told now.
        patience_s: In which time the robot stops by itself.
    """

    def __init__(
        self,
        models: Mapping[CommandKind, mujoco.MjModel],
        braking: Array,
        slowing: Array,
        next_s: float,
        patience_s: float,
    ) -> None:
        self._models = {kind: _for_stepping(model) for kind, model in models.items()}
        self._data = {kind: mujoco.MjData(model) for kind, model in self._models.items()}
        self._braking = braking
        self._slowing = slowing
        self._next_s = next_s
        self._patience_s = patience_s

    def paths(
        self,
        position: Array,
        velocity: Array,
        plan: Plan,
        torque: Array | None = None,
        slowing: Array | None = None,
    ) -> Iterator[Array]:
        """Yields where the arm would be if it were told a plan, rad, shape (N, J) each.

        First if nothing came after it: the robot stops by itself, where it was told no position.
        Then if the bridge stopped it as soon as it can.

        Args:
            position: At first, rad, shape (J,).
            velocity: At first, rad/s, shape (J,).
            plan: What it is told.
            torque: Of a load on the joints, all the while the same, N m, shape (J,); None for none.
            slowing: Speed of the setpoints from which positions are stopped as positions, rad/s,
                shape (J,); None where they are stopped by speeds.
        """
        for data in self._data.values():
            data.qfrc_applied[:] = 0.0 if torque is None else torque
        if plan.kind is CommandKind.POSITION:
            told_s = len(plan.values) * plan.spacing_s
            yield self._told(position, velocity, plan, told_s + _ARRIVES_S)
        else:
            told = self._told(position, velocity, plan, self._patience_s)
            yield np.concatenate([told, *self._stopped(plan.kind, torque is not None, slowing)])
        told = self._told(position, velocity, plan, self._next_s)
        yield np.concatenate([told, *self._stopped(plan.kind, torque is not None, slowing)])

    def _told(self, position: Array, velocity: Array, plan: Plan, for_s: float) -> Array:
        """Returns where a plan leads whose last setpoint stays in force."""
        data, steps = self._data[plan.kind], round(for_s / _STEP_S)
        data.qpos[:], data.qvel[:] = position, velocity
        numbers = (np.arange(steps) * (_STEP_S / plan.spacing_s) + 1e-9).astype(int)
        setpoints = plan.values[np.minimum(numbers, len(plan.values) - 1)]
        return self._followed(plan.kind, setpoints)

    def _stopped(self, kind: CommandKind, sinks: bool, slowing: Array | None) -> Iterator[Array]:
        """Yields where a stop leads from there: its speeds are ramped down by their setpoints.

        An arm that sinks is made to hold its position then, and gives way to its load once more.
        Positions come to rest as positions where they are to stay that.
        """
        if slowing is not None and kind is CommandKind.POSITION:
            yield self._slowed(slowing)
            return
        before, data = self._data[kind], self._data[CommandKind.VELOCITY]
        first = before.qvel.copy()
        data.qpos[:], data.qvel[:] = before.qpos.copy(), first
        if kind is CommandKind.VELOCITY:
            first = smaller(data.ctrl, first)
        settles_s = _SINKS_S if sinks else _SETTLES_S
        until_s = float((np.abs(first) / self._braking).max()) + settles_s
        lost = self._braking * _STEP_S * np.arange(1, round(until_s / _STEP_S) + 1)[:, None]
        yield self._followed(CommandKind.VELOCITY, first - np.clip(first, -lost, lost))
        if sinks:
            yield self._held()

    def _slowed(self, first: Array) -> Array:
        """Returns where an arm goes whose positions come to rest as evenly as they may.

        Args:
            first: At which they go, rad/s, shape (J,): an arm that still gains speed lags behind.
        """
        data = self._data[CommandKind.POSITION]
        until_s = float((np.abs(first) / self._slowing).max())
        lost = self._slowing * _STEP_S * np.arange(round((until_s + _ARRIVES_S) / _STEP_S))[:, None]
        way = _STEP_S * np.cumsum(first - np.clip(first, -lost, lost), axis=0)
        return self._followed(CommandKind.POSITION, data.ctrl + way)

    def _held(self) -> Array:
        """Returns where an arm goes that is told to hold where the stop led it."""
        before, data = self._data[CommandKind.VELOCITY], self._data[CommandKind.POSITION]
        data.qpos[:], data.qvel[:] = before.qpos, before.qvel
        place = before.qpos.copy()
        return self._followed(
            CommandKind.POSITION, np.tile(place, (round(_ARRIVES_S / _STEP_S), 1))
        )

    def _followed(self, kind: CommandKind, setpoints: Array) -> Array:
        model, data = self._models[kind], self._data[kind]
        places = np.empty_like(setpoints)
        for place, setpoint in zip(places, setpoints, strict=True):
            data.ctrl[:] = setpoint
            mujoco.mj_step(model, data)
            place[:] = data.qpos
        return places


def _for_stepping(model: mujoco.MjModel) -> mujoco.MjModel:
    """Returns a model without contacts, limits and gravity, which the robot compensates itself."""
    model.opt.timestep = _STEP_S
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model
