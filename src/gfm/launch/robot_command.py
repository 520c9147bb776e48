"""The command `gfm robot`: what anybody may tell a running robot."""

from __future__ import annotations

import argparse
import getpass
import socket
import sys
from typing import TYPE_CHECKING

from gfm.core import ConfigError, MonotonicClock
from gfm.launch.flags import add_endpoint
from gfm.transport import ZenohTransport, ask
from gfm_wire import Message, ScaleSpeed, StopRobot

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Stops the robot of a running system, or lets it go at a part of the speed that it is commanded.
After `stop` its driver has to begin again. After `speed 0` the arm stands, until whoever slowed it
down says `speed 1`, and its driver goes on.
"""
_TIMEOUT_S = 3.0


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm robot`."""
    parser = subparsers.add_parser(
        "robot", help="stop a running robot, or slow it down", description=_DESCRIPTION
    )
    parser.add_argument("what", choices=("stop", "speed"))
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
    with ZenohTransport.open(
        run=arguments.run_name, name=name, connect=(arguments.connect,), timeout_s=_TIMEOUT_S
    ) as transport:
        ask(transport, key, message, timeout_s=_TIMEOUT_S, clock=MonotonicClock())
    done = "stopped" if isinstance(message, StopRobot) else f"speed {arguments.scale:g}"
    sys.stdout.write(f"{done}\n")
    return 0


def question(what: str, scale: float | None, because: str) -> tuple[str, Message]:
    """Returns what the bridge is asked, and under which key.

    Raises:
        ConfigError: the scale is missing, out of range, or not wanted.
    """
    if what == "stop":
        if scale is not None:
            raise ConfigError(f"stop has the scale {scale:g}, expected none")
        return "robot/stop", StopRobot(reason=because)
    if scale is None or not 0.0 <= scale <= 1.0:
        raise ConfigError(f"speed has the scale {scale}, expected 0 to 1")
    return "robot/speed", ScaleSpeed(scale=scale)
