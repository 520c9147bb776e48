"""Whether memory and handles of a system at full load stay where they are.

    python benchmarks/soak.py --folder runs/soak --minutes 60

Router, replay, learner and actors as `gfm up` starts them learn `point_mass`, nobody held back by
a rate; the ring of replay is small, so that it is soon full. The folder must be new: it gets what
they write, and a look at every process each ten seconds (`soak.jsonl`). The first third of the
time is for caches and the ring to fill; the rest is cut into eighths, of which the least counts:
what waits in a queue for a while is not held. What malloc has handed out is what a process holds. A
line through its leasts has a slope with a standard error. Resident memory is that and what malloc
keeps of what was given back. It goes up and down by steps, without noise around them: a line says
nothing of it, and its growth is what the last eighth has more than the first. Exit status 1: what a
process holds is not shown to grow by less than the bound (slope and two errors), its resident
memory or its handles grew by more, or one died.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scale import cpu_s
from survival import PROGRESS

from gfm.core import BadInputError, MonotonicClock
from gfm.launch import (
    Keeper,
    SupervisionConfig,
    Supervisor,
    SystemSpec,
    actor_processes,
    learner_process,
    own_system,
    replay_process,
    router_process,
    statuses,
    summary,
)
from gfm.service import exit_status

LOG = "soak.jsonl"
ACTORS = 4
CAPACITY_MIB = 16
SAMPLES_PER_INSERT = 32.0
START_S = 1800.0  # on a busy machine
_LOOK_S = 10.0
_STEP_S = 0.2  # as `gfm up`
_WARM = 1.0 / 3.0
#: Growth that would matter to nobody: a fiftieth an hour, which takes two days to double.
_MOST_MIB_H, _MOST_SHARE_H, _MOST_FILES = 2.0, 0.02, 2.0
_PARTS = 8


@dataclass(frozen=True, kw_only=True)
class Course:
    """What one process used over time, after the warm-up.

    Attributes:
        name: The process.
        memory_mib: Resident, least of the first and of the last eighth of the time.
        resident_mib_h: By how much that grew, MiB per hour.
        held_mib_h: Slope of a line through the leasts of what malloc has handed out, MiB per hour.
        error_mib_h: Its standard error.
        open_files: Medians over the first and the last eighth.
    """

    name: str
    memory_mib: tuple[float, float]
    resident_mib_h: float
    held_mib_h: float
    error_mib_h: float
    open_files: tuple[float, float]

    @property
    def is_flat(self) -> bool:
        """Whether it grew by less than the bound in an hour; what it holds, within two errors."""
        few, many = self.open_files
        most = max(_MOST_MIB_H, _MOST_SHARE_H * self.memory_mib[0])
        held = self.held_mib_h + 2.0 * self.error_mib_h
        return max(held, self.resident_mib_h) <= most and many - few <= _MOST_FILES


def make_system(folder: Path) -> SystemSpec:
    """Returns router, replay, learner and actors that nobody holds back."""
    env = ("--env", "point_mass")
    ratio = ("--max-samples-per-insert", f"{SAMPLES_PER_INSERT:g}")
    small = ("--capacity-mib", str(CAPACITY_MIB))
    processes = (
        router_process(),
        replay_process(("--folder", str(folder / "replay"), *ratio, *small)),
        learner_process((*env, "--checkpoint-dir", str(folder / "checkpoints"))),
        *actor_processes(ACTORS, 0, env),
    )
    return own_system("soak", folder, processes)


def look(supervisor: Supervisor, keeper: Keeper, began_s: float) -> dict[str, Any]:
    """Returns what everybody did and uses now; who does not answer in time is left out."""
    found = statuses(supervisor.transport, timeout_s=1.0)
    sums = summary(found)
    return {
        "at_s": round(time.monotonic() - began_s, 1),
        "missing": keeper.missing,
        "memory_mib": {one.name: round(one.gauges["memory_mib"], 2) for one in found},
        **{
            gauge: {one.name: one.gauges[gauge] for one in found}
            for gauge in ("heap_mib", "python_blocks", "open_files")
        },
        "cpu_s": sum(cpu_s(child.pid) for child in supervisor.children if child.status is None),
        **{counter: sums[counter] for counter in PROGRESS},
    }


def soak(folder: Path, minutes: float) -> list[dict[str, Any]]:
    """Lets the system run, and returns a look at it each ten seconds.

    Raises:
        GfmError: it could not be started, or a process was given up.
    """
    rows, clock = [], MonotonicClock()
    with Supervisor(make_system(folder), folder / "logs", start_timeout_s=START_S) as supervisor:
        supervisor.start()
        keeper = Keeper(supervisor, SupervisionConfig(), clock)
        began_s = time.monotonic()
        with (folder / LOG).open("w", encoding="utf-8") as log:
            while (passed_s := time.monotonic() - began_s) < 60.0 * minutes:
                keeper.step()
                if passed_s >= _LOOK_S * len(rows):
                    rows.append(look(supervisor, keeper, began_s))
                    print(json.dumps(rows[-1]), file=log, flush=True)
                time.sleep(_STEP_S)
    return rows


def courses(rows: Sequence[dict[str, Any]]) -> list[Course]:
    """Returns what each process used after the warm-up, as far as it answered."""
    warm = [row for row in rows if row["at_s"] >= _WARM * rows[-1]["at_s"]]
    names = {name for row in warm for name in row["memory_mib"]}
    return [_course(name, warm) for name in sorted(names)]


def _course(name: str, rows: Sequence[dict[str, Any]]) -> Course:
    there = [row for row in rows if name in row["memory_mib"]]
    parts = [part for part in np.array_split(np.array(there, dtype=object), _PARTS) if len(part)]
    hours = [float(np.mean([row["at_s"] for row in part])) / 3600.0 for part in parts]
    memory, heap = (
        [min(row[gauge][name] for row in part) for part in parts]
        for gauge in ("memory_mib", "heap_mib")
    )
    files = [statistics.median(row["open_files"][name] for row in part) for part in parts]
    slope, error = line(hours, heap)
    return Course(
        name=name,
        memory_mib=(memory[0], memory[-1]),
        resident_mib_h=(memory[-1] - memory[0]) / max(hours[-1] - hours[0], 1e-9),
        held_mib_h=slope,
        error_mib_h=error,
        open_files=(files[0], files[-1]),
    )


def line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Returns the slope of a line by least squares, and its standard error.

    Infinite where fewer than three points say nothing about it.
    """
    if len(x) < 3:
        return 0.0, np.inf
    at = np.subtract(x, np.mean(x))
    slope = float(at @ np.asarray(y) / (at @ at))
    left = np.subtract(y, np.mean(y)) - slope * at
    return slope, float(np.sqrt(left @ left / (len(x) - 2) / (at @ at)))


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Returns the table, and below it what was done in all."""
    everybody = max(len(row["memory_mib"]) for row in rows)
    whole = [row for row in rows if len(row["memory_mib"]) == everybody]
    first, last, end_s = whole[0], whole[-1], rows[-1]["at_s"]
    passed_s = max(last["at_s"] - first["at_s"], 1e-9)
    rates = [f"{(last[one] - first[one]) / passed_s:.0f} {one}/s" for one in PROGRESS]
    cores = (last["cpu_s"] - first["cpu_s"]) / passed_s
    return [
        "| process | resident MiB, first eighth | last | MiB an hour | handed out by malloc, "
        "MiB an hour | handles, first and last |",
        "|---|---|---|---|---|---|",
        *(
            f"| {c.name} | {c.memory_mib[0]:.1f} | {c.memory_mib[1]:.1f} | "
            f"{_signed(c.resident_mib_h)} | {_signed(c.held_mib_h)} ± {c.error_mib_h:.2f} | "
            f"{c.open_files[0]:.0f} and {c.open_files[1]:.0f} |"
            for c in courses(rows)
        ),
        "",
        f"{end_s / 60:.0f} minutes, looked at after {_WARM * end_s / 60:.0f}; {', '.join(rates)}; "
        f"{cores:.2f} of {os.cpu_count()} processors; looks: {len(rows)}, at which somebody did "
        f"not answer in time: {len(rows) - len(whole)}, at which somebody was missing: "
        f"{sum(bool(row['missing']) for row in rows)}",
    ]


def _signed(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}"  # no minus nought


def main() -> int:
    """Soaks, and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="new")
    parser.add_argument("--minutes", type=float, default=60.0, help="(default: %(default)s)")
    asked = parser.parse_args()
    if asked.folder.exists():
        raise BadInputError(f"--folder {asked.folder}: exists, expected a new one")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    asked.folder.mkdir(parents=True)
    rows = soak(asked.folder, asked.minutes)
    print("\n".join(table(rows)))
    calm = not any(row["missing"] for row in rows)
    return 0 if calm and all(course.is_flat for course in courses(rows)) else 1


if __name__ == "__main__":
    sys.exit(exit_status(main))
