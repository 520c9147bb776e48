"""How soon a system on this machine is whole again after one of its processes was killed or hung.

    python benchmarks/survival.py --tries 5

Real processes, as `gfm up` starts them, learn `point_mass`; each is in turn ended by SIGKILL or
stopped by SIGSTOP. Printed is, per process, how long it takes until it beats again, and until
actors, replay and learner all have made progress beyond what they had when it was hurt.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gfm.core import MonotonicClock
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

PROGRESS = ("env_steps", "replay_sequences", "learner_steps")
HANG_DEADLINE_S = 5.0
_LOOK_S = 0.05
_SURVEY_S = 0.3
_SETTLE_S = 3.0


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """One process, hurt once.

    Attributes:
        back_s: Until it beat again.
        whole_s: Until everybody answered and had made progress.
    """

    back_s: float
    whole_s: float


def make_system(folder: Path) -> SystemSpec:
    """Returns router, replay, learner and two actors with the settings of `gfm up`."""
    env = ("--env", "point_mass")
    processes = (
        router_process(),
        replay_process(("--folder", str(folder / "replay"))),
        learner_process((*env, "--checkpoint-dir", str(folder / "checkpoints"))),
        *actor_processes(2, 0, (*env, "--max-steps-per-s", "200")),
    )
    return own_system("survival", folder, processes)


def hurt(supervisor: Supervisor, keeper: Keeper, name: str, how: signal.Signals) -> Recovery:
    """Returns how long it took to recover from a signal to one process."""
    before = progress(supervisor)
    began_s = time.monotonic()
    pid = pid_of(supervisor, name)
    os.kill(pid, how)

    def wait(true: Callable[[], bool]) -> float:
        while not true():
            keeper.step()
            time.sleep(_LOOK_S)
        return time.monotonic() - began_s

    wait(lambda: pid_of(supervisor, name) != pid)
    back_s = wait(lambda: not keeper.missing)
    # What a process that started anew counts begins at zero: the first look is what counts then.
    least = dict(before)
    for counter, value in progress(supervisor).items():
        least[counter] = min(least[counter], value)
    whole_s = wait(lambda: grew(progress(supervisor), least))
    wait(lambda: time.monotonic() - began_s >= whole_s + _SETTLE_S)
    return Recovery(back_s=back_s, whole_s=whole_s)


def pid_of(supervisor: Supervisor, name: str) -> int:
    """Returns the process id that a name has now."""
    return next(child.pid for child in supervisor.children if child.spec.name == name)


def progress(supervisor: Supervisor) -> dict[str, int]:
    """Returns what actors, replay and learner have done; 0 where one does not answer."""
    sums = summary(statuses(supervisor.transport, timeout_s=_SURVEY_S))
    return {counter: sums[counter] for counter in PROGRESS}


def grew(now: dict[str, int], least: dict[str, int]) -> bool:
    """Returns whether everybody has done more than that."""
    return all(now[counter] > least[counter] for counter in PROGRESS)


def row(name: str, how: signal.Signals, recoveries: list[Recovery]) -> str:
    """Returns a row of the table."""
    back = [one.back_s for one in recoveries]
    whole = [one.whole_s for one in recoveries]
    return (
        f"| {name} | {how.name} | {len(recoveries)} | {statistics.median(back):.1f} | "
        f"{max(back):.1f} | {statistics.median(whole):.1f} | {max(whole):.1f} |"
    )


def main() -> None:
    """Hurts everybody in turn and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=5, help="per process (default: %(default)s)")
    tries = parser.parse_args().tries
    names = ("router", "replay", "learner", "actor-0")
    deadlines = dict.fromkeys(("router", "replay", "learner", "actor"), HANG_DEADLINE_S)
    # Every try is the first: what died before does not lengthen the pause.
    config = SupervisionConfig(deadline_s=deadlines, stop_s=1.0, within_s=1.0)
    with tempfile.TemporaryDirectory() as folder:
        system = make_system(Path(folder))
        with Supervisor(system, Path(folder) / "logs") as supervisor:
            supervisor.start()
            keeper = Keeper(supervisor, config, MonotonicClock())
            print(
                "| process | by | tries | beats again, median s | most | whole, median s | most |"
            )
            print("|---|---|---|---|---|---|---|")
            for how in (signal.SIGKILL, signal.SIGSTOP):
                for name in names:
                    found = [hurt(supervisor, keeper, name, how) for _ in range(tries)]
                    print(row(name, how, found), flush=True)


if __name__ == "__main__":
    main()
