"""What is seen of a robot: joints as measured, the object as tracked, the tool by a model.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import numpy as np

from gfm.core import Observation, RefusedError
from gfm.core.checks import Array
from gfm.envs.arm import ArmProblem
from gfm.envs.matching_view import Scene
from gfm.sim.cell import END_EFFECTOR_SITE
from gfm.sim.kinematics import SiteKinematics, body_axes

#: How old a pose may become, s of the robot's time.
_LONGEST_UNSEEN_S = 1.0
#: A pose of the object where it makes no difference.
_SOMEWHERE = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
#: In so many steps, each straight in the joints, a tool is raised.
_STEPS_UP = 10


@final
class RobotView:
    """Reads what the bridge reports by the model that says where the tool is.

    Args:
        arm: The cell by which the tool is placed, furnished for the task.
    """

    def __init__(self, arm: ArmProblem) -> None:
        self._arm, self._layout = arm, arm.model.layout
        self._tip = SiteKinematics(arm.nominal, END_EFFECTOR_SITE)

    def joints(self, report: Observation) -> tuple[Array, Array]:
        """Returns positions from the arm's zero, rad, and speeds, rad/s, each of shape (1, J)."""
        return report.position[None] - self._arm.zero, report.velocity[None]

    def scene(self, report: Observation) -> Scene:
        """Returns tool and object.

        Raises:
            RefusedError: the robot reports no object, or it was not seen for a second.
        """
        if report.object_position is None or report.object_quaternion is None:
            raise RefusedError("the robot reports no object")
        unseen_s = (report.stamp_ns - report.object_stamp_ns) * 1e-9
        if unseen_s > _LONGEST_UNSEEN_S:
            raise RefusedError(f"the object was last seen {unseen_s:.1f} s ago")
        pose = np.concatenate([report.object_position, report.object_quaternion])[None]
        qpos = self._layout.as_qpos(report.position[None], pose)
        return Scene(
            tip=self._tip.positions(qpos), position=pose[:, :3], axes=body_axes(pose[:, 3:])
        )

    def tool(self, joints: Array) -> Array:
        """Returns where the tool is, m, shape (3,), for joints in rad, shape (J,)."""
        return np.asarray(self._tip.positions(self._layout.as_qpos(joints[None], _SOMEWHERE))[0])

    def upwards(self, joints: Array) -> Array:
        """Returns how joints, rad, (J,), move for the tool to rise: rad per m, shape (J,)."""
        qpos = self._layout.as_qpos(joints[None], _SOMEWHERE)
        moves = self._tip.jacobian(qpos[0])[:, self._layout.dof]
        return np.asarray(np.linalg.pinv(moves) @ [0.0, 0.0, 1.0])

    def raised(self, joints: Array, height_m: float) -> Array:
        """Returns joints, rad, shape (J,), with which the tool is higher by so much."""
        for _ in range(_STEPS_UP):
            joints = joints + self.upwards(joints) * (height_m / _STEPS_UP)
        return joints
