"""How a Sawyer behind a rosbridge stops, seen by a client of its own, with real processes.

    python benchmarks/rosbridge_stops.py --tries 20 --latency-s 0.005 --jitter-s 0.01 --loss 0.02
    python benchmarks/rosbridge_stops.py --tries 100 --parts build/rosbridge_stops

All joints are driven at 5 % or 50 % of their speed limits, in each mode, by 20 commands a second,
then stopped in every way. Bridge, robot and driver are processes on this machine, on its clock;
between bridge and robot is a relay that can be cut.

With --parts several processes share the work, and what was broken off goes on.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from bridge_rig import LIMITS
from bridge_stops import ALLOWED, commanded, speeds
from parts import Part, commits, done_parts, print_or_write
from rosbridge_cell import CLOCK, PERIOD_S, Cell, Seen, end

from gfm.core import CommandKind, RefusedError
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES
from gfm_wire import StopRobot

_SHARES, _SECONDS = (0.05, 0.5), 0.6
#: Share of a speed limit below which a joint is still, in the mean over so many reports: their
#: noise is 0.002 rad/s, an eighth of that and less.
_STILL, _MEAN = 0.01, 5
#: In a report, between the head and the torso.
_ARM = slice(1, 8)
_BEFORE_NS = 100_000_000
_TRIES_IN_A_PART = 10


@dataclass(frozen=True, kw_only=True)
class Stop:
    """How it came to rest.

    Attributes:
        still_s: From the cause until all joints are still.
        way_rad: That the joint that went farthest went meanwhile.
        share: Of its speed limit that the fastest joint had at the cause.
    """

    still_s: float
    way_rad: float
    share: float


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


@dataclass(frozen=True, kw_only=True)
class Tries:
    """Some stops of one kind.

    Attributes:
        share: Of the speed limits, that all joints are driven at ...
        kind: ... in this mode.
        cause: Of the stop, a key of CAUSES.
        first: Number of the first of them.
        count: How many.
    """

    share: float
    kind: CommandKind
    cause: str
    first: int
    count: int

    @property
    def name(self) -> str:
        """The name of the part: a file's name."""
        words = (
            f"{self.share:.2f} {self.cause} {self.kind} {self.first} to {self.first + self.count}"
        )
        return words.replace(" ", "_")

    def made(self, line: Sequence[str]) -> Part:
        """Stops a robot behind such a line."""
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            cell = Cell(folder, stack, line, ("--velocity-share", str(ALLOWED)))
            numbers = range(self.first, self.first + self.count)
            stops = [self._tried(cell, forth=number % 2 == 0) for number in numbers]
        names = ("still_s", "way_rad", "share")
        return {name: [getattr(stop, name) for stop in stops] for name in names}

    def _tried(self, cell: Cell, *, forth: bool) -> Stop:
        """Drives the arm, stops it, and returns how it came to rest.

        On a busy machine something may stand still for so long that the arm is stopped before: then
        it is tried again.
        """
        while True:
            cell.make_ready()
            try:
                drive(cell, self.kind, self.share if forth else -self.share)
            except RefusedError as error:
                sys.stderr.write(f"again: {error}\n")
            else:
                break
        began_ns, cause = CLOCK.now_ns(), CAUSES[self.cause]
        cause(cell)
        CLOCK.sleep_until_ns(began_ns + 1_500_000_000)
        stop = stopped(cell.witness.since(began_ns - _BEFORE_NS), began_ns)
        if cause is cut:
            cell.mend()
        if cause in (ended, killed):
            cell.start_bridge()
        return stop


def drive(cell: Cell, kind: CommandKind, share: float) -> None:
    """Drives all joints at a share of their speed limits, away from the ends of their ranges."""
    speed = speeds(share)
    answer = cell.send(CommandKind.VELOCITY, np.zeros(len(JOINT_NAMES)), begins=True)
    target, due_ns = answer.position, CLOCK.now_ns()
    for _ in range(round(_SECONDS / PERIOD_S)):
        target = target + PERIOD_S * speed
        answer = cell.send(kind, commanded(kind, target, speed, answer.velocity))
        due_ns += round(PERIOD_S * 1e9)
        CLOCK.sleep_until_ns(due_ns)


def stopped(seen: list[Seen], began_ns: int) -> Stop:
    """Returns how an arm came to rest that was seen from shortly before the cause on."""
    speed = np.array([one.velocity for one in seen])[:, _ARM] / LIMITS.velocity
    mean = np.abs(_means(speed)).max(axis=1)
    ends = np.array([one.at_ns for one in seen])[_MEAN - 1 :]
    moving = ends[mean >= _STILL]
    position = np.array([one.position for one in seen if one.at_ns >= began_ns])[:, _ARM]
    return Stop(
        still_s=max(0.0, (int(moving[-1]) - began_ns) * 1e-9) if len(moving) else 0.0,
        way_rad=float(np.abs(position - position[0]).max()),
        share=float(mean[ends <= began_ns].max(initial=0.0)),
    )


def _means(values: Array) -> Array:
    """Returns the means over windows of reports, shape (reports - window + 1, joints)."""
    windows = np.lib.stride_tricks.sliding_window_view(values, _MEAN, axis=0)
    return np.asarray(windows.mean(axis=-1))


def report(done: Mapping[Tries, Part], ran_on: str) -> str:
    """Returns a table in Markdown."""
    kinds: dict[tuple[float, str, CommandKind], list[Part]] = {}
    for tries, part in done.items():
        kinds.setdefault((tries.share, tries.cause, tries.kind), []).append(part)
    lines = [
        f"Commit {ran_on}.",
        "",
        "| from | stopped by | mode | tries | fastest / limit | still after, s: median | longest | "
        "way, rad |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (share, cause, kind), parts in kinds.items():
        still, way, fast = (
            np.concatenate([part[name] for part in parts])
            for name in ("still_s", "way_rad", "share")
        )
        lines.append(
            f"| {share:.0%} | {cause} | {kind} | {len(still)} | {np.median(fast):.3f} | "
            f"{np.median(still):.3f} | {still.max():.3f} | {way.max():.3f} |"
        )
    return "\n".join((*lines, ""))


def main() -> None:
    """Stops, and writes a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=20, help="of each kind")
    parser.add_argument("--causes", nargs="+", choices=CAUSES, default=list(CAUSES))
    for name in ("latency-s", "jitter-s", "loss"):
        parser.add_argument(f"--{name}", default="0", help="of the line to the robot")
    parser.add_argument("--parts", type=Path, help="where parts are kept (default: nowhere)")
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    line = [word for name in ("latency_s", "jitter_s", "loss")
            for word in (f"--{name.replace('_', '-')}", getattr(arguments, name))]  # fmt: skip
    kinds = product(
        _SHARES, arguments.causes, CommandKind, range(0, arguments.tries, _TRIES_IN_A_PART)
    )
    works = [
        Tries(share=share, cause=cause, kind=kind, first=first,
              count=min(_TRIES_IN_A_PART, arguments.tries - first))
        for share, cause, kind, first in kinds
    ]  # fmt: skip
    by_name = {work.name: work for work in works}
    with tempfile.TemporaryDirectory() as place:
        folder = arguments.parts or Path(place)
        parts = done_parts(folder, list(by_name), lambda name: by_name[name].made(line))
    done = {work: parts[name] for name, work in by_name.items() if name in parts}
    print_or_write(report(done, commits(parts)), arguments.out)


if __name__ == "__main__":
    main()
