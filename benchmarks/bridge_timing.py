"""How punctual the robot bridge is on a busy machine.

    python benchmarks/bridge_timing.py --minutes 10 --busy 2

A bridge at 20 Hz, a Sawyer behind a rosbridge and a driver are processes of their own on the wall
clock; beside them so many processes compute without pause. The driver sends slow speeds, one
command a period, and the bridge records. Then the recording and the bridge's status say how late
periods began, how many were missed, and how long a command took from being heard to being sent.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from parts import print_or_write
from rosbridge_cell import CLOCK, PERIOD_S, Cell, end

from gfm.core import RefusedError, Status
from gfm.core.checks import Array
from gfm.recording.mcap_file import read_mcap
from gfm.recording.periods import TIMING, TIMING_TOPIC
from gfm_wire import RecordDone, RecordStart, RecordStop

_SPEED, _TURNS_S = 0.05, 2.0
#: Computes a share of every 20 ms.
_BUSY = """
import sys, time
share = float(sys.argv[1])
while True:
    until = time.monotonic() + 0.02 * share
    while time.monotonic() < until:
        pass
    if share < 1.0:
        time.sleep(0.02 * (1.0 - share))
"""


def busy(count: int, share: float, stack: ExitStack) -> None:
    """Starts processes that compute for a share of their time, each in a session of its own."""
    for _ in range(count):
        process = subprocess.Popen(
            [sys.executable, "-c", _BUSY, str(share)], start_new_session=True
        )
        stack.callback(end, process)


def driven(cell: Cell, seconds: float) -> tuple[int, int]:
    """Drives to and fro; returns how many commands were answered, and how often it was stopped.

    A driver that is not scheduled is silent: the bridge stops the robot, and it begins again.
    """
    due_ns, answered, stopped, begins = CLOCK.now_ns(), 0, 0, True
    for number in range(round(seconds / PERIOD_S)):
        due_ns = max(due_ns + round(PERIOD_S * 1e9), CLOCK.now_ns())
        CLOCK.sleep_until_ns(due_ns)
        sign = 1.0 if int(number * PERIOD_S / _TURNS_S) % 2 == 0 else -1.0
        try:
            cell.command(sign * _SPEED, begins=begins)
            answered, begins = answered + 1, False
        except RefusedError as error:
            sys.stderr.write(f"{number * PERIOD_S:.0f} s: {error}\n")
            stopped, begins = stopped + (not begins), True
    return answered, stopped


def delays(path: Path) -> Array:
    """Returns how long each command took from being heard to being sent, ms."""
    told = read_mcap(path, {TIMING_TOPIC: TIMING.name}).messages[TIMING_TOPIC]
    taken = [one.heard_to_decided_ms + one.decided_to_sent_ms for one in told]
    return np.array([value for value in taken if np.isfinite(value)])


def since(before: Status, after: Status) -> dict[str, int]:
    """Returns what was counted between two statuses."""
    return {name: count - before.counters[name] for name, count in after.counters.items()}


def table(counted: Mapping[str, int], taken: Array, counts: tuple[int, int]) -> str:
    """Returns what came of it, in Markdown."""
    bins = {name: count for name, count in counted.items() if name.startswith("jitter_")}
    late = sum(bins[f"jitter_to_{end}_ms"] for end in (10, 20, 50)) + bins["jitter_over_50_ms"]
    middle, most = np.quantile(taken, (0.5, 0.99))
    rows = {
        "periods": f"{sum(bins.values()):,}",
        "periods missed (overruns)": f"{counted['overruns']}",
        "begun more than 1 ms late": f"{late + bins['jitter_to_2_ms'] + bins['jitter_to_5_ms']}",
        "begun more than 5 ms late": f"{late}",
        "from heard to sent, median": f"{middle:.2f} ms",
        "from heard to sent, 99 % at most": f"{most:.2f} ms",
        "from heard to sent, most": f"{taken.max():.2f} ms",
        "commands answered": f"{counts[0]:,}",
        "stops": f"{counts[1]}",
    }
    lines = ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Drives, and writes how punctual that was."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--busy", type=int, default=2, help="processes that compute beside it")
    parser.add_argument("--share", type=float, default=1.0, help="of the time that each computes")
    parser.add_argument("--realtime", action="store_true", help="as the bridge's flag")
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        cell = Cell(folder, stack, bridge=("--realtime",) if arguments.realtime else ())
        cell.make_ready()
        before = cell.status()
        busy(arguments.busy, arguments.share, stack)
        cell.ask("robot/record", RecordStart(name="timing"))
        counts = driven(cell, 60.0 * arguments.minutes)
        status = cell.status()
        done = cell.ask("robot/record", RecordStop(), timeout_s=10.0)
        if not isinstance(done, RecordDone):
            raise TypeError(f"got {type(done).__name__}, expected RecordDone")
        taken = delays(Path(done.path))
        if not len(taken):
            sys.exit("error: no command was answered; expected a machine that is less busy")
        text = table(since(before, status), taken, counts)
    print_or_write(text, arguments.out)


if __name__ == "__main__":
    main()
