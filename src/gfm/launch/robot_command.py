"""The command `gfm robot`: what anybody may tell a running robot."""

from __future__ import annotations

import argparse
import getpass
import socket
import sys
from typing import TYPE_CHECKING

from gfm.core import ConfigError, MonotonicClock
from gfm.launch.flags import add_endpoint, address_of
from gfm.transport import ask
from gfm_wire import Message, PowerAction, PowerRobot, Role, ScaleSpeed, StopRobot

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Stops the robot of a running system, or lets it go at a part of the speed that it is commanded.
After `stop` its driver has to begin again. After `speed 0` the arm stands, until whoever slowed it
down says `speed 1`, and its driver goes on. The drives of a real one are switched on and off
(`enable`, `disable`), cut as by its e-stop button (`estop`), and a stop or an error is cleared
(`reset`): nothing moves by that.
"""
_TIMEOUT_S = 3.0
#: A robot takes up to 5 s until its drives are on.
_POWER_TIMEOUT_S = 8.0


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm robot`."""
    parser = subparsers.add_parser(
        "robot", help="stop a running robot, slow it down, enable it", description=_DESCRIPTION
    )
    parser.add_argument("what", choices=("stop", "speed", *map(str, PowerAction)))
    parser.add_argument("scale", type=float, nargs="?", metavar="SCALE", help="0 to 1, of speed")
    parser.add_argument(
        "--because", default="a person said so", metavar="TEXT", help="what its driver is told"
    )
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Tells the robot's bridge, and says what it did."""
    key, message = question(arguments.what, arguments.scale, arguments.because)
    name = f"{getpass.getuser()}@{socket.gethostname()}"
    # Whoever watches may stop; all else takes a driver.
    role = Role.WATCHER if isinstance(message, StopRobot) else Role.DRIVER
    with address_of(arguments).open(role, name=name, timeout_s=_TIMEOUT_S) as transport:
        waits_s = _POWER_TIMEOUT_S if isinstance(message, PowerRobot) else _TIMEOUT_S
        ask(transport, key, message, timeout_s=waits_s, clock=MonotonicClock())
    sys.stdout.write(f"{_done(message)}\n")
    return 0


def question(what: str, scale: float | None, because: str) -> tuple[str, Message]:
    """Returns what the bridge is asked, and under which key.

    Raises:
        ConfigError: the scale is missing, out of range, or not wanted.
    """
    if what != "speed" and scale is not None:
        raise ConfigError(f"{what} has the scale {scale:g}, expected none")
    if what == "stop":
        return "robot/stop", StopRobot(reason=because)
    if what != "speed":
        return "robot/power", PowerRobot(action=PowerAction(what))
    if scale is None or not 0.0 <= scale <= 1.0:
        got = "no scale" if scale is None else f"the scale {scale:g}"
        raise ConfigError(f"speed has {got}, expected 0 to 1")
    return "robot/speed", ScaleSpeed(scale=scale)


def _done(message: Message) -> str:
    match message:
        case ScaleSpeed(scale=scale):
            return f"speed {scale:g}"
        case PowerRobot(action=action):
            return f"{action}: done"
        case _:
            return "stopped"
