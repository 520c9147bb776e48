"""The robot's computer: modes, watchdog, enabling and the e-stop, in front of a simulated arm."""

from __future__ import annotations

from typing import Any, final

from gfm.core import RefusedError
from gfm_robot_bridge.intera.topics import (
    COMMAND_TIMEOUT,
    ENABLE,
    JOINT_COMMAND,
    RESET,
    SPEED_RATIO,
    STOP,
    URDF,
)
from gfm_robot_bridge.rosbridge_sawyer.messages import (
    read_command,
    read_number,
    read_payload,
    read_switch,
)
from gfm_robot_bridge.simulated.robot import SimulatedRobot

_LONGEST_PATIENCE_S = 1.0
_UNPRESSED, _PRESSED, _UNKNOWN, _RELEASED = range(4)
_NONE, _USER, _BY_SOFTWARE, _FAULT = range(4)


@final
class Controller:
    """Switched off at first.

    Args:
        robot: With its brakes off.
    """

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._enabled = self._stopped = self._error = False
        self._button, self._source = _UNPRESSED, _NONE
        self._configured_ns = 0
        self._switch()

    def hear(self, topic: str, msg: object, now_ns: int) -> None:
        """Does what a message on a topic tells.

        Args:
            topic: Its name.
            msg: The message.
            now_ns: On the robot's clock.

        Raises:
            RefusedError: it is no such message, or nobody listens on that topic.
        """
        match topic:
            case JOINT_COMMAND.name:
                self._robot.take(read_command(msg, now_ns))
            case COMMAND_TIMEOUT.name:
                patience_s = min(max(read_number(msg), 0.0), _LONGEST_PATIENCE_S)
                self._robot.patience_ns = round(patience_s * 1e9)
            case SPEED_RATIO.name:
                read_number(msg)  # of its own way to a position, which setpoints never need
            case ENABLE.name:
                self._enabled = read_switch(msg) and not (self._stopped or self._error)
            case STOP.name:
                self._halt(self._button, self._source or _BY_SOFTWARE)
            case RESET.name:
                self._reset()
            case URDF.name:
                self._configure(msg)
            case _:
                raise RefusedError(f"nobody listens on {topic}")
        self._switch()

    def press(self, *, pressed: bool) -> None:
        """Presses the e-stop button, or releases it."""
        if pressed:
            self._halt(_PRESSED, _USER)
        elif self._button == _PRESSED:
            self._button = _RELEASED
        self._switch()

    def break_joint(self) -> None:
        """Has a joint report a fault."""
        self._error = True
        self._halt(_UNKNOWN, _FAULT)
        self._switch()

    def state(self) -> dict[str, Any]:
        """Returns intera_core_msgs/RobotAssemblyState."""
        return {
            "homed": True,
            "ready": self._enabled,
            "enabled": self._enabled,
            "stopped": self._stopped,
            "error": self._error,
            "lowVoltage": False,
            "estop_button": self._button,
            "estop_source": self._source,
        }

    def _configure(self, msg: object) -> None:
        """Takes a part of its own description, unless it has that already, by its time."""
        stamp_ns, payload = read_payload(msg)
        if stamp_ns != self._configured_ns:
            self._configured_ns = stamp_ns
            self._robot.carry(payload)

    def _halt(self, button: int, source: int) -> None:
        self._stopped, self._enabled = True, False
        self._button, self._source = button, source

    def _reset(self) -> None:
        if self._button == _PRESSED:
            return
        self._stopped = self._error = self._enabled = False
        self._button, self._source = _UNPRESSED, _NONE

    def _switch(self) -> None:
        """Puts the brakes on, or takes them off, where that changed."""
        if self._enabled:
            self._robot.release()
        elif not self._robot.is_braked:
            self._robot.brake()
