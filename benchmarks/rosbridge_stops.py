"""How a Sawyer behind a rosbridge stops, seen by a client of its own, with real processes.

    python benchmarks/rosbridge_stops.py --tries 20 --latency-s 0.005 --jitter-s 0.01 --loss 0.02

All joints are driven at 0.3 rad/s in velocity mode by 20 commands a second, then stopped in every
way. Bridge, robot and driver are processes on this machine, on its clock; between bridge and robot
is a relay that can be cut.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbridge_cell import CLOCK, Cell, Seen, end

from gfm.core import RefusedError
from gfm.core.checks import Array
from gfm_wire import StopRobot

_SPEED, _SECONDS = 0.3, 0.6
#: Reports over whose mean a joint is still below this, rad/s; their noise is 0.002.
_STILL, _MEAN = 0.01, 5


@dataclass(frozen=True, kw_only=True)
class Stop:
    """How it came to rest.

    Attributes:
        still_s: From the cause until all joints are still.
        way_rad: That the joint that went farthest went meanwhile.
    """

    still_s: float
    way_rad: float


def silent(_cell: Cell) -> None:
    """Says nothing any more."""


def requested(cell: Cell) -> None:
    """Asks the bridge to stop."""
    cell.ask("robot/stop", StopRobot(reason="tried"))


def button(cell: Cell) -> None:
    """Presses the e-stop button."""
    cell.witness.press(pressed=True)


def cut(cell: Cell) -> None:
    """Cuts the line between bridge and robot."""
    cell.cut()


def ended(cell: Cell) -> None:
    """Tells the bridge to end."""
    end(cell.bridge)


def killed(cell: Cell) -> None:
    """Kills the bridge."""
    cell.bridge.send_signal(signal.SIGKILL)
    cell.bridge.wait()


CAUSES: dict[str, Callable[[Cell], None]] = {
    "driver silent": silent,
    "stopped by request": requested,
    "e-stop button": button,
    "line cut": cut,
    "bridge told to end": ended,
    "bridge killed": killed,
}


def tried(cell: Cell, cause: Callable[[Cell], None], speed: float) -> Stop:
    """Drives the arm, stops it, and returns how it came to rest.

    On a busy machine something may stand still for so long that the arm is stopped before: then it
    is tried again.
    """
    while True:
        cell.make_ready()
        try:
            cell.drive(speed, _SECONDS)
        except RefusedError as error:
            sys.stderr.write(f"again: {error}\n")
        else:
            break
    began_ns = CLOCK.now_ns()
    cause(cell)
    CLOCK.sleep_until_ns(began_ns + 1_500_000_000)
    stop = stopped(cell.witness.since(began_ns), began_ns)
    if cause is cut:
        cell.mend()
    if cause in (ended, killed):
        cell.start_bridge()
    return stop


def stopped(seen: list[Seen], began_ns: int) -> Stop:
    """Returns how an arm came to rest that was seen from the cause on."""
    velocity = np.array([s.velocity for s in seen])
    mean = np.abs(_means(velocity)).max(axis=1)
    moving = np.flatnonzero(mean >= _STILL)
    last = (int(moving[-1]) if len(moving) else 0) + _MEAN - 1
    way = np.abs(np.array([s.position for s in seen]) - seen[0].position)
    return Stop(still_s=(seen[last].at_ns - began_ns) * 1e-9, way_rad=float(way.max()))


def _means(values: Array) -> Array:
    """Returns the means over windows of reports, shape (reports - window + 1, joints)."""
    windows = np.lib.stride_tricks.sliding_window_view(values, _MEAN, axis=0)
    return np.asarray(windows.mean(axis=-1))


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=20)
    for name in ("latency-s", "jitter-s", "loss"):
        parser.add_argument(f"--{name}", default="0")
    arguments = parser.parse_args()
    line = [word for name in ("latency_s", "jitter_s", "loss")
            for word in (f"--{name.replace('_', '-')}", getattr(arguments, name))]  # fmt: skip
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        cell = Cell(Path(folder), stack, line)
        print("| stopped by | still after, s: median | longest | way, rad: longest |")
        print("|---|---|---|---|")
        for name, cause in CAUSES.items():
            stops = [
                tried(cell, cause, _SPEED if k % 2 == 0 else -_SPEED)
                for k in range(arguments.tries)
            ]
            still = [stop.still_s for stop in stops]
            way = max(stop.way_rad for stop in stops)
            print(f"| {name} | {np.median(still):.3f} | {max(still):.3f} | {way:.3f} |")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
