"""Recordings of motions that are known in closed form, and a model of what makes them."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.sim.plant import Plant, make_plant

EPOCH_NS = 1_700_000_000_000_000_000
MASS, LENGTH, ROTOR = 1.0, 0.3, 0.02
MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" armature="0.02" {range}/>
      <inertial pos="0 0 -0.3" mass="1" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""
ACTUATORS = {
    CommandKind.POSITION: '<position name="a" joint="a" kp="40" kv="4"/>',
    CommandKind.VELOCITY: '<velocity name="a" joint="a" kv="10"/>',
    CommandKind.EFFORT: '<motor name="a" joint="a"/>',
}

Signals = dict[str, np.ndarray]
Make = Callable[..., Trajectory]


@pytest.fixture
def make() -> Make:
    """Returns what makes a recording of signals of shape (T,) or (T, J)."""
    return recording


def recording(
    time_s: np.ndarray, position: np.ndarray, kind: str = "position", **other: object
) -> Trajectory:
    """Returns a recording; whatever is not given is None, or equal to what is given."""
    stamp_ns = EPOCH_NS + np.round(time_s * 1e9).astype(np.int64)
    columns = position.reshape(len(time_s), -1)
    names = tuple("abcdefg"[: columns.shape[1]])
    told = np.asarray(other.pop("command", position)).reshape(-1, len(names))
    values = {
        "name": "one",
        "stamp_ns": stamp_ns,
        "command_stamp_ns": stamp_ns,
        "velocity": None,
        "effort": None,
    } | other
    for signal in ("velocity", "effort"):
        if values[signal] is not None:
            values[signal] = np.asarray(values[signal]).reshape(columns.shape)
    return Trajectory(
        joint_names=names,
        position=columns,
        command=told,
        command_kind=CommandKind(kind),
        **values,
    )


@pytest.fixture
def pendulum() -> Callable[..., Plant]:
    """Returns what makes the pendulum whose motions `swing` describes."""

    def plant(kind: str = "position", joint_range: str = "", text: str = MODEL) -> Plant:
        limits = f'limited="true" range="{joint_range}"' if joint_range else ""
        xml = text.format(actuator=ACTUATORS[CommandKind(kind)], range=limits)
        return make_plant(mujoco.MjSpec.from_string(xml), ("a",))

    return plant


@pytest.fixture
def swing() -> Callable[..., tuple[np.ndarray, Signals]]:
    """Returns a swing of the pendulum: times, and position, velocity, acceleration and torque."""

    def motion(
        amplitude: float = 0.8, hz: float = 0.7, seconds: float = 4.0
    ) -> tuple[np.ndarray, Signals]:
        t = np.arange(0.0, seconds, 0.01)
        w = 2.0 * np.pi * hz
        q = amplitude * (np.sin(w * t) + 0.4 * np.sin(2.3 * w * t + 1.0))
        v = amplitude * w * (np.cos(w * t) + 0.92 * np.cos(2.3 * w * t + 1.0))
        a = -amplitude * w**2 * (np.sin(w * t) + 2.116 * np.sin(2.3 * w * t + 1.0))
        inertia = MASS * LENGTH**2 + ROTOR
        torque = inertia * a + MASS * 9.81 * LENGTH * np.sin(q)
        return t, {"position": q, "velocity": v, "acceleration": a, "torque": torque}

    return motion
