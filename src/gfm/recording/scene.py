"""Where the links of an arm are, for whoever looks on or opens a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.recording.messages import BASE_FRAME, Frame
from gfm.sim.sawyer import sawyer_spec
from gfm.sim.urdf import urdf


@final
class Scene:
    """The frames of a model's bodies, by forward kinematics.

    Args:
        spec: The model; its world is the robot's base frame.
        joint_names: In the order of every array; the model's other joints stay where they are.
        speeds: Limits by joint, rad/s.
        efforts: The same, N m.

    Attributes:
        description: The arm as URDF.
        model_xml: The model as MJCF.
        fixed: Frames that do not move in their parents.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        joint_names: Sequence[str],
        *,
        speeds: Mapping[str, float],
        efforts: Mapping[str, float],
    ) -> None:
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._places = [int(model.joint(name).qposadr[0]) for name in joint_names]
        self.description = urdf(model, root=BASE_FRAME, speeds=speeds, efforts=efforts)
        self.model_xml = spec.to_xml()
        bodies = range(1, model.nbody)
        self._moving = [body for body in bodies if model.body_jntnum[body]]
        self.fixed = tuple(
            self._frame(body, model.body_pos[body], model.body_quat[body])
            for body in bodies
            if body not in self._moving
        )

    def moving(self, position: Array) -> list[Frame]:
        """Returns where the other frames are in their parents, for rad, shape (J,)."""
        self._data.qpos[self._places] = position
        mujoco.mj_kinematics(self._model, self._data)
        return [self._in_parent(body) for body in self._moving]

    def _in_parent(self, body: int) -> Frame:
        parent = self._model.body_parentid[body]
        place, turn, back = np.empty(3), np.empty(4), np.empty(4)
        mujoco.mju_negQuat(back, self._data.xquat[parent])
        mujoco.mju_rotVecQuat(place, self._data.xpos[body] - self._data.xpos[parent], back)
        mujoco.mju_mulQuat(turn, back, self._data.xquat[body])
        return self._frame(body, place, turn)

    def _frame(self, body: int, position: Array, quaternion: Array) -> Frame:
        parent = int(self._model.body_parentid[body])
        return Frame(
            parent=self._model.body(parent).name if parent else BASE_FRAME,
            child=self._model.body(body).name,
            position=position.copy(),
            quaternion=quaternion.copy(),
        )


def sawyer_scene(joint_names: Sequence[str], speeds: Array, efforts: Array) -> Scene:
    """Returns the nominal arm's.

    Args:
        joint_names: J of them.
        speeds: Limits, rad/s, shape (J,).
        efforts: The same, N m.
    """
    return Scene(
        sawyer_spec(command=CommandKind.POSITION),
        joint_names,
        speeds=dict(zip(joint_names, speeds.tolist(), strict=True)),
        efforts=dict(zip(joint_names, efforts.tolist(), strict=True)),
    )
