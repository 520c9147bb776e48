"""Whether memory and handles of a system at full load stay where they are.

    python benchmarks/soak.py --folder runs/soak --minutes 60

Router, replay, learner and actors as `gfm up` starts them learn `point_mass`, nobody held back by
a rate; the ring of replay is small, so that it is soon full. The folder must be new: it gets what
they write, and a look at every process each ten seconds (`soak.jsonl`). The first third of the time
is for caches and the ring to fill. Exit status 1: a process grew after that, or one died.
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
START_S = 300.0  # on a busy machine
_LOOK_S = 10.0
_STEP_S = 0.2  # as `gfm up`
_WARM = 1.0 / 3.0
#: What a heap that is used for long may differ by, from one tenth of the time to another.
_MOST_MIB, _MOST_SHARE, _MOST_FILES = 2.0, 0.02, 2.0


@dataclass(frozen=True, kw_only=True)
class Course:
    """What one process used over time, after the warm-up.

    Attributes:
        name: The process.
        memory_mib: Medians over the first and the last tenth.
        slope_mib_h: Of a straight line through all looks, MiB per hour.
        open_files: Medians over the first and the last tenth.
    """

    name: str
    memory_mib: tuple[float, float]
    slope_mib_h: float
    open_files: tuple[float, float]

    @property
    def is_flat(self) -> bool:
        """Whether it did not grow."""
        (first, last), (few, many) = self.memory_mib, self.open_files
        return last - first <= max(_MOST_MIB, _MOST_SHARE * first) and many - few <= _MOST_FILES


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
    hours = np.array([row["at_s"] for row in there]) / 3600.0
    memory = [row["memory_mib"][name] for row in there]
    files = [row["open_files"][name] for row in there]
    line = np.polyfit(hours, memory, 1) if len(there) > 1 else np.zeros(2)
    slope = round(float(line[0]), 6) + 0.0  # no minus nought
    return Course(name=name, memory_mib=_ends(memory), slope_mib_h=slope, open_files=_ends(files))


def _ends(values: Sequence[float]) -> tuple[float, float]:
    """Returns the medians of the first and of the last tenth."""
    some = max(len(values) // 10, 1)
    return statistics.median(values[:some]), statistics.median(values[-some:])


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Returns the table, and below it what was done in all."""
    everybody = max(len(row["memory_mib"]) for row in rows)
    whole = [row for row in rows if len(row["memory_mib"]) == everybody]
    first, last, end_s = whole[0], whole[-1], rows[-1]["at_s"]
    passed_s = max(last["at_s"] - first["at_s"], 1e-9)
    rates = [f"{(last[one] - first[one]) / passed_s:.0f} {one}/s" for one in PROGRESS]
    cores = (last["cpu_s"] - first["cpu_s"]) / passed_s
    head = "| process | MiB, first tenth | last tenth | MiB an hour | handles, first and last |"
    return [
        head,
        "|---|---|---|---|---|",
        *(
            f"| {c.name} | {c.memory_mib[0]:.1f} | {c.memory_mib[1]:.1f} | {c.slope_mib_h:+.2f} | "
            f"{c.open_files[0]:.0f} and {c.open_files[1]:.0f} |"
            for c in courses(rows)
        ),
        "",
        f"{end_s / 60:.0f} minutes, looked at after {_WARM * end_s / 60:.0f}; {', '.join(rates)}; "
        f"{cores:.2f} of {os.cpu_count()} processors; looks: {len(rows)}, at which somebody did "
        f"not answer in time: {len(rows) - len(whole)}, at which somebody was missing: "
        f"{sum(bool(row['missing']) for row in rows)}",
    ]


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
