"""The port of every robot, real or simulated: nothing but the bridge knows one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence

from gfm.core import Command, Observation, RefusedError
from gfm.core.checks import Array
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.torque import Dynamics
from gfm_wire import PowerAction, SetPayload


class Robot(ABC):
    """One arm. Nothing here waits: an exchange is begun and asked for until it is there.

    Attributes:
        joint_names: In the order of every array.
        limits: What the joints may do.
        command_latency_ns: From a command's stamp until it acts, as the robot documents it.
        patience_s: For how long it goes on with what it was told, without hearing more.
        dynamics: Its torques and motions; None where they are not known.
    """

    joint_names: tuple[str, ...]
    limits: Limits
    command_latency_ns: int
    patience_s: float
    dynamics: Dynamics | None

    @abstractmethod
    def time_ns(self) -> int:
        """Returns what the robot's clock shows now: commands are stamped with it."""

    @abstractmethod
    def begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        """Sends commands and asks for what the sensors report.

        Args:
            commands: Stamped with the robot's time, oldest first, in the order of the joints; the
                robot keeps them until then.
            advance_ns: How long to let a robot run whose time passes on demand; ignored by others.
        """

    def place_object(self, pose: Array) -> bool:
        """Puts the free object somewhere, at rest, with the next exchange.

        Args:
            pose: Base frame, m and quaternion w x y z, shape (7,).

        Returns:
            Whether it can; at a robot that cannot, a person does it.
        """
        del pose
        return False

    def carry(self, payload: SetPayload) -> bool:
        """Tells it what its last link carries, with the next exchange: its compensation bears that.

        Returns:
            Whether it can be told; at a robot that cannot, a person does it.
        """
        del payload
        return False

    @abstractmethod
    def poll(self) -> tuple[Observation, ...] | None:
        """Returns the reports since the last exchange, oldest first; None while under way.

        Raises:
            UnreachableError: the robot does not answer.
            RefusedError: it said no.
        """

    def fault(self) -> str:
        """Returns why it does not move whatever it is told, in words; empty where it does.

        A fault that came and went since the last call is told, once.
        """
        return ""

    def power(self, action: PowerAction) -> Callable[[], bool]:
        """Begins to switch the drives, or to clear a fault; never happens by itself.

        Returns:
            What to ask whether it is done; it raises RefusedError where it did not come to that.

        Raises:
            RefusedError: it cannot, or makes no sense now.
        """
        raise RefusedError(f"{action}: this robot has nothing to switch")

    def counters(self) -> Mapping[str, int]:
        """Returns what it counts, by name."""
        return {}

    def gauges(self) -> Mapping[str, float]:
        """Returns what else it measures of itself, by name with unit."""
        return {}

    def about(self) -> Mapping[str, str]:
        """Returns what recordings and flight records say of it."""
        return {}

    def close(self) -> None:  # noqa: B027  what is no connection need not be let go of
        """Lets go of it, after it was told the last time."""


def told(payload: SetPayload | None) -> Mapping[str, str]:
    """Returns what `Robot.about` says of a payload that a robot was told of; nothing of none."""
    return {"payload_told": str(payload)} if payload is not None and payload.mass_kg else {}
