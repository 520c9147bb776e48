"""What more and more actor processes cost router, replay and learner, and what they leave behind.

    python benchmarks/scale.py --actors 4 16 64

Actors of `point_mass` join a running system, each with one sequence a second; then all but the
first group leave. Costs are processor time, which a busy machine changes little. Printed are, per
number of actors, the costs of each message and the memory and handles of each process.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from gfm.core import Status
from gfm.launch import (
    Supervisor,
    actor_processes,
    learner_process,
    own_system,
    replay_process,
    router_process,
    statuses,
)

ENV = ("--env", "point_mass")
RATE = ("--num-envs", "1", "--max-steps-per-s", "10")
SERVICES = ("router", "replay", "learner")
PATIENCE_S = 1500.0
_TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, kw_only=True)
class Count:
    """What all have done and used until now.

    Attributes:
        at_s: When.
        sequences: That replay has taken.
        steps: Of the learner.
        cpu_s: Processor time by role, of all its processes.
    """

    at_s: float
    sequences: int
    steps: int
    cpu_s: dict[str, float]


def cpu_s(pid: int) -> float:
    """Returns the processor time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def counted(supervisor: Supervisor) -> Count:
    """Returns what all have done and used until now."""
    used: dict[str, float] = {}
    for child in supervisor.children:
        if child.status is None:
            used[child.spec.role] = used.get(child.spec.role, 0.0) + cpu_s(child.pid)
    told = {status.role: status.counters for status in asked(supervisor)}
    sequences, steps = told["replay"]["replay_sequences"], told["learner"]["learner_steps"]
    return Count(at_s=time.monotonic(), sequences=sequences, steps=steps, cpu_s=used)


def asked(supervisor: Supervisor) -> list[Status]:
    """Returns what all say, once the services answer, too."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        found = statuses(supervisor.transport, timeout_s=5.0)
        if {status.role for status in found} >= set(SERVICES):
            return found
    raise TimeoutError(f"no answer from {', '.join(SERVICES)} within {PATIENCE_S:g} s")


def until_actors(supervisor: Supervisor, count: int) -> float:
    """Returns how long it took until so many actors answer and have acted, s."""
    began_s = time.monotonic()
    while time.monotonic() - began_s < PATIENCE_S:
        actors = [status for status in asked(supervisor) if status.role == "actor"]
        if len(actors) == count and all(one.counters["sequences_acked"] for one in actors):
            return time.monotonic() - began_s
        time.sleep(0.5)
    raise TimeoutError(f"no {count} actors within {PATIENCE_S:g} s")


def row(supervisor: Supervisor, count: int, joined_s: float, window_s: float) -> str:
    """Returns what so many actors cost, over a window of time."""
    before = counted(supervisor)
    time.sleep(window_s)
    after = counted(supervisor)
    sequences, steps = after.sequences - before.sequences, after.steps - before.steps
    ms = {role: 1e3 * (after.cpu_s[role] - before.cpu_s[role]) for role in after.cpu_s}
    told = asked(supervisor)
    memory = {one.role: one.gauges["memory_mib"] for one in told}
    files = {one.role: one.gauges["open_files"] for one in told}
    per = [f"{ms[role] / max(sequences, 1):.2f}" for role in ("router", "replay", "actor")]
    return " | ".join(
        [
            f"| {count}",
            f"{joined_s:.0f}",
            f"{sequences / (after.at_s - before.at_s):.1f}",
            *per,
            f"{ms['learner'] / max(steps, 1):.1f}",
            f"{memory['actor']:.0f} / {memory['router']:.0f} / {memory['replay']:.0f}",
            f"{files['router']:.0f} |",
        ]
    )


def leave(supervisor: Supervisor, stay: int) -> str:
    """Lets all actors but the first go; returns what they leave behind."""
    leaving = [child for child in supervisor.children if child.spec.role == "actor"][stay:]
    acked = sum(s.counters["sequences_acked"] for s in asked(supervisor) if s.role == "actor")
    began_s = time.monotonic()
    for child in leaving:
        child.terminate()
    for child in leaving:
        child.finish(PATIENCE_S)
    statuses_ = [child.status for child in leaving]
    told = asked(supervisor)
    counters = {one.role: one.counters for one in told}
    router = next(one.gauges for one in told if one.role == "router")
    return (
        f"{len(leaving)} left in {time.monotonic() - began_s:.0f} s, exit statuses "
        f"{sorted(set(statuses_), key=str)}; {acked} acknowledged before, "
        f"{counters['replay']['replay_sequences']} in replay, given up "
        f"{counters['replay']['given_up']}; router {router['memory_mib']:.0f} MiB, "
        f"{router['open_files']:.0f} handles"
    )


def main() -> None:
    """Lets them join and leave, and prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--actors", type=int, nargs="+", default=[4, 16, 64])
    parser.add_argument("--window-s", type=float, default=30.0, help="of each row")
    asked_for = parser.parse_args()
    counts = sorted(asked_for.actors)
    with tempfile.TemporaryDirectory() as folder:
        replay = ("--folder", f"{folder}/replay", "--max-samples-per-insert", "8")
        learner = (*ENV, "--checkpoint-dir", f"{folder}/checkpoints")
        services = (router_process(), replay_process(replay), learner_process(learner))
        system = own_system("scale", Path(folder), services)
        with Supervisor(
            system, Path(folder) / "logs", start_timeout_s=PATIENCE_S, stop_timeout_s=60.0
        ) as supervisor:
            supervisor.start()
            everybody = actor_processes(counts[-1], 0, (*ENV, *RATE))
            print(
                "| actors | joined after, s | sequences/s | router, ms each | replay, ms each | "
                "actor, ms each | learner, ms a step | MiB actor / router / replay | "
                "router's handles |\n" + "|---" * 9 + "|",
                flush=True,
            )
            there = 0
            for count in counts:
                began_s = time.monotonic()
                supervisor.add(*everybody[there:count])
                there = count
                until_actors(supervisor, count)
                joined_s = time.monotonic() - began_s
                print(row(supervisor, count, joined_s, asked_for.window_s), flush=True)
            print(leave(supervisor, counts[0]), flush=True)


if __name__ == "__main__":
    main()
