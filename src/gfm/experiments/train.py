"""What `gfm train` does: all services as processes of this machine, watched until they are done."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from gfm.core import BadInputError, Clock
from gfm.experiments.progress import Phase, RunProgress
from gfm.experiments.train_config import RunFolder, TrainConfig, open_run
from gfm.experiments.train_curves import SystemCurves, in_words
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
    sequence_length_of,
    statuses,
)
from gfm.transport import Transport

_CHECK_NS, _ROW_NS = 200_000_000, 5_000_000_000
_START, _LEARN = "start the services", "learn"
#: Expected of a start, and of one learner step on two cores, s.
_START_S, _STEP_S = 8.0, 0.03
#: A training run may be one of several on a busy machine.
START_TIMEOUT_S = 300.0
#: The seeds of different starts of one run lie so far apart.
_LIFE_SEEDS = 1000


@dataclass(frozen=True, kw_only=True)
class TrainRequest:
    """What is asked for.

    Attributes:
        config: The experiment's file.
        out: The run's folder.
        resume: Whether it goes on with one that is there.
        begin_from: File of the policy with which a new one begins; None for a random one.
    """

    config: Path
    out: Path
    resume: bool = False
    begin_from: Path | None = None


def train(
    request: TrainRequest, console: Console, clock: Clock, stopped: Callable[[], bool]
) -> RunFolder:
    """Trains until all steps are made or `stopped` says so, and returns where everything is.

    Raises:
        BadInputError: the experiment cannot be used, or a service refuses its settings.
        GfmError: a service failed.
    """
    fresh = not request.out.exists()
    config, folder = open_run(
        request.out, request.config, resume=request.resume, begin_from=request.begin_from
    )
    curves = SystemCurves(folder)
    system = training_system(config, folder, curves.life)
    phases = [
        Phase(name=_START, expected_s=_START_S),
        Phase(name=_LEARN, expected_s=_STEP_S * config.learner_steps),
    ]
    try:
        with (
            RunProgress(phases, console=console, clock=clock) as progress,
            Supervisor(
                system, folder.logs, start_timeout_s=START_TIMEOUT_S, clock=clock
            ) as supervisor,
        ):
            with progress.phase(_START):
                supervisor.start(stopped)
            with progress.phase(_LEARN):
                keeper = Keeper(supervisor, SupervisionConfig(), clock)
                _follow(
                    keeper,
                    supervisor.transport,
                    curves,
                    progress,
                    config.learner_steps,
                    clock,
                    stopped,
                )
    except BadInputError:
        if fresh:  # a service refused its settings: nothing was learned
            shutil.rmtree(request.out)
        raise
    finally:
        curves.close()
    console.print(f"policy: {folder.policy}", soft_wrap=True, highlight=False)
    if curves.learner_steps < config.learner_steps:
        console.print("stopped before the end: --resume goes on", highlight=False)
    return folder


def _follow(
    keeper: Keeper,
    transport: Transport,
    curves: SystemCurves,
    progress: RunProgress,
    learner_steps: int,
    clock: Clock,
    stopped: Callable[[], bool],
) -> None:
    """Writes a row every few seconds; in between, what has died or hangs is started again."""
    begun: int | None = None
    row_ns = clock.now_ns()
    while not stopped():
        keeper.step()
        if clock.now_ns() >= row_ns:
            row_ns = clock.now_ns() + _ROW_NS
            found = statuses(transport)
            if all(status.role != "learner" for status in found):
                continue  # it is being started again
            row = curves.add(found, clock.utc_ns() * 1e-9)
            begun = curves.learner_steps if begun is None else begun
            share = (curves.learner_steps - begun) / max(learner_steps - begun, 1)
            progress.say(in_words(row, learner_steps), share=share)
            if curves.learner_steps >= learner_steps:
                return
        clock.sleep_until_ns(clock.now_ns() + _CHECK_NS)


def training_system(config: TrainConfig, folder: RunFolder, life: int) -> SystemSpec:
    """Returns the processes of a run.

    Args:
        config: The experiment.
        folder: Of the run; the services read its copy of the experiment's file.
        life: Starts of this run before this one.
    """

    def told(section: str) -> tuple[str, ...]:
        return ("--config", str(folder.config), "--section", section)

    learner = (
        *told("learner"),
        *("--env", config.env, "--seed", str(config.seed)),
        *("--max-steps", str(config.learner_steps)),
        *("--checkpoint-dir", str(folder.checkpoints)),
        *(("--init", str(folder.begun_from)) if folder.begun_from.is_file() else ()),
    )
    seed = config.seed + _LIFE_SEEDS * life
    processes = (
        router_process(),
        replay_process(
            (*told("replay"), "--seed", str(seed), "--folder", str(folder.replay)),
            sequence_length_of(folder.config, "actor"),
        ),
        learner_process(learner),
        *actor_processes(config.actors, seed, (*told("actor"), "--env", config.env)),
    )
    return own_system("train", folder.path, processes)
