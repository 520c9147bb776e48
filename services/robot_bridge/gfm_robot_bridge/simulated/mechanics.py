"""The port behind which an engine moves the simulated robot: arm, drives, object.

Clock, command buffer, sensors and cameras stand in front of it and are the same for every engine.

Shape letters: J joints.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from gfm.core import RefusedError
from gfm.core.checks import Array
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.servo import Servo
from gfm_wire import SetPayload


class Mechanics(ABC):
    """The arm with its drives and whatever it hides, and the object in front of it.

    Attributes:
        servo: The drives.
    """

    servo: Servo

    @property
    @abstractmethod
    def position(self) -> Array:
        """What ideal encoders on the links report, rad, shape (J,)."""

    @property
    @abstractmethod
    def velocity(self) -> Array:
        """Of the links, rad/s, shape (J,)."""

    @property
    @abstractmethod
    def object_pose(self) -> Array | None:
        """Of the object, m and quaternion w x y z, shape (7,); None where there is none."""

    @abstractmethod
    def put_object(self, pose: Array) -> None:
        """Puts the object somewhere, at rest.

        Args:
            pose: m and quaternion w x y z, shape (7,).

        Raises:
            RefusedError: there is no object.
        """

    @abstractmethod
    def carry(self, payload: SetPayload) -> None:
        """Has the gravity compensation bear a load, in place of what it bore beside arm and tool.

        What hangs on the arm does not change by that.
        """

    @abstractmethod
    def drive(self) -> Array:
        """Returns the torque of the drives now, with gravity compensation, N m, shape (J,)."""

    @abstractmethod
    def step(self, h: float) -> None:
        """Lets `h` seconds pass, in which the command stays what it is."""


#: Makes one at rest, holding its position: of the joints, rad, shape (J,); what it hides; what it
#: has in its hand and in front of it.
MakeMechanics = Callable[[Array, Sequence[HiddenEffect], Cell], Mechanics]


def no_object() -> RefusedError:
    """Returns what is raised where an object is to be put that does not exist."""
    return RefusedError("there is no object to put anywhere")
