"""Hurts a learning system again and again, and counts what it lost and how soon it was whole.

    python benchmarks/faults.py --folder runs/faults --kills 100 --others 60 --seed 0

Faults are drawn from the seed: SIGKILL of any process, SIGSTOP until the keeper sees it or for a
moment, cut lines, clocks set back, full disks. After each, everybody has to answer and to go on.
In the end the actors' ledgers are laid beside what replay kept. The folder keeps what was done: the
same command goes on where it was broken off, or out of time (`--minutes`), and prints the table
when all is done. Exit status 1: something was lost, doubled, or never came back.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from fault_rig import ACTORS, LINES, RATIO, NeverWholeError, Rig

from gfm_replay.audit import Audit, audit_folders

ACTOR_NAMES = tuple(f"actor-{i}" for i in range(ACTORS))
#: Who can be hurt so, by the name of the rig's method.
TARGETS = {
    "kill": ("router", "replay", "learner", *ACTOR_NAMES),
    "hang": ("router", "replay", "learner", *ACTOR_NAMES),
    "freeze": ("router", "replay", "learner", *ACTOR_NAMES),
    "cut": LINES,
    "set_back": ("replay", "learner", *ACTOR_NAMES),
    "fill_disk": ("replay", "learner"),
}
LOG = "faults.jsonl"


def plan(kills: int, others: int, seed: int) -> list[tuple[str, str]]:
    """Returns kinds of faults and whom they hit, in random order."""
    rng = np.random.default_rng(seed)
    rest = [kind for kind in TARGETS if kind != "kill"]
    kinds = ["kill"] * kills + [rest[i % len(rest)] for i in range(others)]
    return [(kind, str(rng.choice(TARGETS[kind]))) for kind in rng.permutation(kinds).tolist()]


def done(folder: Path) -> list[dict[str, Any]]:
    """Returns what was done before."""
    path = folder / LOG
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def hurt(rig: Rig, kind: str, name: str, rng: np.random.Generator) -> dict[str, Any]:
    """Returns what came of one fault; what the rig counts is told as of now."""
    began_s = time.monotonic()
    getattr(rig, kind)(name, rng)
    ended_s = time.monotonic()
    rig.whole()
    # What lasts as long as it is told to is no part of the recovery.
    from_s = began_s if kind in ("kill", "hang", "set_back") else ended_s
    whole_s = time.monotonic() - from_s
    told = rig.everybody()
    gauges = {status.role: status.gauges for status in told}
    return {
        "rig": rig.began_ns,
        "kind": kind,
        "name": name,
        "whole_s": round(whole_s, 3),
        "samples_per_insert": gauges["replay"]["samples_per_insert"],
        "memory_mib": {status.name: round(status.gauges["memory_mib"], 1) for status in told},
        "open_files": {status.name: status.gauges["open_files"] for status in told},
        "keeper_files": len(os.listdir("/proc/self/fd")),  # noqa: PTH208
        "versions_back": rig.versions_back,
        "resumes": [rig.resumes.alike, rig.resumes.otherwise, rig.resumes.unknown],
    }


def hurt_all(folder: Path, faults: Sequence[tuple[str, str]], seed: int, minutes: float) -> bool:
    """Does what is left of the faults; returns whether all are done."""
    end_s, before = time.monotonic() + 60.0 * minutes, len(done(folder))
    rig = Rig(folder)
    try:
        rig.whole()
        for number, (kind, name) in enumerate(faults[before:], start=before):
            if time.monotonic() > end_s:
                return False
            rng = np.random.default_rng((seed, number))
            rig.pause(rng.uniform(0.5, 2.0))
            row = hurt(rig, kind, name, rng)
            with (folder / LOG).open("a", encoding="utf-8") as log:
                log.write(json.dumps(row) + "\n")
            print(f"{number + 1} of {len(faults)}: {kind} {name}: {row['whole_s']:.1f} s")
            sys.stdout.flush()
        return True
    finally:
        rig.stop()


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Returns how soon the system was whole, by fault and role."""
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in rows:
        found[row["kind"], row["name"].partition("-")[0]].append(row["whole_s"])
    head = ["| fault | process | times | whole, median s | most |", "|---|---|---|---|---|"]
    order = list(TARGETS)
    return head + [
        f"| {kind} | {role} | {len(t)} | {statistics.median(t):.1f} | {max(t):.1f} |"
        for (kind, role), t in sorted(found.items(), key=lambda one: order.index(one[0][0]))
    ]


def figures(rows: Sequence[dict[str, Any]], audit: Audit) -> list[str]:
    """Returns the sums in words."""
    ratios = [row["samples_per_insert"] for row in rows]
    alike, otherwise, unknown = resumes(rows)
    kills = [row["whole_s"] for row in rows if row["kind"] == "kill"]
    files, memory = ends(rows, "open_files"), ends(rows, "memory_mib")
    return [
        f"{len(rows)} faults; whole after a kill: median {statistics.median(kills):.1f} s",
        f"{audit.acknowledged} acknowledged in {audit.lives} lives of actors; lost {audit.lost}, "
        f"doubled {audit.doubled}, changed {audit.changed}, evicted {audit.evicted}",
        f"samples per insert {min(ratios):.3f} to {max(ratios):.3f}, held between {RATIO[0]:g} "
        f"and {RATIO[1]:g}",
        f"learners that went on: {alike} acted on a probe as before, {otherwise} otherwise, "
        f"{unknown} not known",
        f"versions that went back: {sum(row['versions_back'] for row in last_of_runs(rows))}",
        f"open files of the services, first and last tenth: {files}; memory, MiB: {memory}",
        f"open files of the keeper: {rows[0]['keeper_files']} and {rows[-1]['keeper_files']}",
    ]


def resumes(rows: Sequence[dict[str, Any]]) -> tuple[int, ...]:
    """Returns how many learners went on alike, otherwise, and nobody knows how."""
    counts = [row["resumes"] for row in last_of_runs(rows)]
    return tuple(sum(column) for column in zip(*counts, strict=True))


def last_of_runs(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the last row of each time that the command ran: a count begins anew with each."""
    return [
        row
        for row, after in zip(rows, [*rows[1:], None], strict=True)
        if after is None or after["rig"] != row["rig"]
    ]


def ends(rows: Sequence[dict[str, Any]], name: str) -> str:
    """Returns the mean of the services' sums in the first and the last tenth of the rows."""
    sums, some = [sum(row[name].values()) for row in rows], max(len(rows) // 10, 1)
    return f"{statistics.mean(sums[:some]):.0f} and {statistics.mean(sums[-some:]):.0f}"


def main() -> int:
    """Does what is left, and prints what came of all of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="new, or of this command")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--others", type=int, default=60, help="faults of other kinds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="after that it is broken off")
    asked = parser.parse_args()
    # Services are run by `set_back`, which lies beside this file.
    here = str(Path(__file__).resolve().parent)
    os.environ["PYTHONPATH"] = os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    asked.folder.mkdir(parents=True, exist_ok=True)
    faults = plan(asked.kills, asked.others, asked.seed)
    if len(done(asked.folder)) < len(faults):
        try:
            if not hurt_all(asked.folder, faults, asked.seed, asked.minutes):
                print("out of time: the same command goes on")
                return 1
        except NeverWholeError as error:
            print(f"after {len(done(asked.folder))} faults: {error}")
            return 1
    audit = audit_folders(asked.folder / "replay", asked.folder / "ledgers")
    rows = done(asked.folder)
    print("\n".join([*table(rows), "", *figures(rows, audit)]))
    return 0 if audit.is_sound and not resumes(rows)[1] else 1


if __name__ == "__main__":
    sys.exit(main())
