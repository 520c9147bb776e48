"""What the load of a Sawyer arm is observed by: its published model, with tool and payload.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.cell import EndEffector
from gfm.sim.sawyer import hang_payload, sawyer_spec
from gfm.sim.sawyer_numbers import VELOCITY_GAIN
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.load import Balance, LoadObserver
from gfm_robot_bridge.sawyer_guard import TOOLS
from gfm_wire import SetPayload


@final
class SawyerBalance(Balance):
    """The nominal arm, upright; its drives bear its weight, which they report."""

    def __init__(self, tool: EndEffector) -> None:
        self._tool = tool
        self.carry(SetPayload(mass_kg=0.0, com_m=np.zeros(3)))

    @override
    def needed(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        data = self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = position, velocity, acceleration
        mujoco.mj_inverse(self._model, data)
        return np.array(data.qfrc_inverse)

    @override
    def carry(self, payload: SetPayload) -> None:
        spec = sawyer_spec(command=CommandKind.EFFORT, end_effector=self._tool)
        if payload.mass_kg:
            hang_payload(spec, payload.mass_kg, payload.com_m)
        self._model = spec.compile()
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)


def sawyer_load(config: BridgeConfig) -> LoadObserver:
    """Returns what observes the load of a Sawyer.

    Args:
        config: Says which tool the robot knows of, by the task, and from when on a load counts.
    """
    return LoadObserver(SawyerBalance(TOOLS[config.task]), VELOCITY_GAIN, config.unnoticed_load_nm)
