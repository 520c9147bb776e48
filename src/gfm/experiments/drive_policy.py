"""What `gfm drive` does: starts robot and bridge, makes attempts, keeps what came of them."""

from __future__ import annotations

import shutil
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from gfm.api.folders import check_folder
from gfm.api.provenance import command_line, provenance
from gfm.core import BadInputError, Clock, MonotonicClock
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.envs.matching import Matching
from gfm.envs.matching_task import TASKS
from gfm.envs.outcomes import Outcome
from gfm.experiments.attempt_files import RESULT, Kept
from gfm.experiments.attempt_start import AsideError
from gfm.experiments.attempts import Attempt, AttemptRunner, planned
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.drive_robot import robot_of
from gfm.experiments.driver import Driver
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_for, policy_path
from gfm.experiments.payload import carrying
from gfm.experiments.person import Keyboard, Person
from gfm.experiments.progress import clock_face
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights
from gfm.report.evaluation import REASONS, Evaluation, evaluation_texts, print_evaluation
from gfm.report.files import write_texts
from gfm.service import StopSignal
from gfm.sim.sawyer import JOINT_NAMES

_WAIT_S = 30.0
#: So many attempts one after the other are put off at most.
_PUT_OFF = 3
#: In a folder in which no attempt came to its end.
_LEFT = ("certs", "logs", "recordings", "sealed.json")
_SIMULATED = {"sim": "on a simulated robot", "drake": "on a simulated robot in Drake"}


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What came of a policy on a robot.

    Attributes:
        attempts: All that are there.
        report: On them; None where there is none.
    """

    attempts: list[Attempt]
    report: Evaluation | None


def drive_policy(request: DriveRequest, console: Console | None = None) -> Driven:
    """Makes the attempts that are not there yet, and prints what came of all.

    Args:
        request: What is asked for.
        console: Where to print; the terminal by default.

    Raises:
        BadInputError: policy and task do not go together, or the folder holds something else.
        UnreachableError: the robot does not answer.
        KeyboardInterrupt: a signal ended it; what there is is kept.
    """
    _check_own(request.out)
    path = policy_path(request.policy or shipped_policy(request.task))
    task = TASKS[request.task]
    arm = load_arm(EvaluationRequest(task=request.task, model=request.model))
    policy = policy_for(path, read_weights(path), Matching(task, arm, 1).spec)
    kept = Kept(request.out, request.about(path))
    plan = planned(request.goals, request.trials)
    left = deque(one for one in plan if one not in kept.done)
    clock, console = MonotonicClock(), console or Console()

    def all_made(driver: Driver, person: Person) -> None:
        attempts = AttemptRunner(
            task, arm, policy.mean_action, driver, seed=request.seed, person=person
        )
        attempts.begin()
        began_ns, before = clock.now_ns(), len(kept.attempts)
        for made in attempts_made(attempts, left, partial(_free_name, request, clock), console):
            kept.add(made)
            each_s = 1e-9 * (clock.now_ns() - began_ns) / (len(kept.attempts) - before)
            console.print(_line(made, len(kept.attempts), request, each_s * len(left)))

    interrupted = on_robot(request, clock, arm.zero, all_made) if left else False
    report = _report(request, path, kept) if kept.attempts else None
    if report is not None:
        write_texts(request.out, evaluation_texts(report))
        print_evaluation(console, report)
    if interrupted:
        raise KeyboardInterrupt
    return Driven(attempts=kept.attempts, report=report)


def attempts_made(
    attempts: AttemptRunner,
    left: deque[tuple[int, int]],
    name: Callable[[int, int], str],
    console: Console,
) -> Iterator[Attempt]:
    """Yields attempts as they are made, until none is left or a person ends it.

    Where the object does not come to lie where an attempt begins, that one is put off to the end:
    another one begins elsewhere.

    Args:
        attempts: Makes them.
        left: Goal and trial of each, first the next one; those that are made are taken out.
        name: Returns the name of a recording, by goal and trial.
        console: Where to say what is put off.

    Raises:
        AsideError: several were put off one after the other.
    """
    put_off = 0
    while left:
        goal, trial = left[0]
        try:
            made = attempts.make(goal, trial, name(goal, trial))
        except AsideError as error:
            put_off += 1
            if put_off == _PUT_OFF:
                raise
            console.print(f"goal {goal + 1}: put off: {error}")
            left.rotate(-1)
            continue
        if made is not None:
            left.popleft()
            put_off = 0
            yield made
        elif not attempts.resumes():
            return


def _check_own(out: Path) -> None:
    """Raises BadInputError where a folder to write to holds what no `gfm drive` left there."""
    check_folder(out)
    if out.exists() and not (out / RESULT).exists():
        others = sorted(one.name for one in out.iterdir() if one.name not in _LEFT)
        if others:
            raise BadInputError(
                f"{out}: holds {others[0]}; expected a new folder, or one of an earlier gfm drive"
            )


def _report(request: DriveRequest, policy: Path, kept: Kept) -> Evaluation:
    config = request.robot_config
    files = {
        "policy": (policy,),
        "model": () if request.model is None else (request.model,),
        "robot's settings": () if config is None else (config,),
    }
    return Evaluation(
        task=TASKS[request.task],
        attempts=kept.together(request.task),
        trials=request.trials,
        provenance=provenance(files, request.seed, command_line()) | request.about(policy),
        where=f"on the robot of run {request.run_name}"
        if request.connect
        else _SIMULATED[request.robot],
    )


def on_robot(
    request: DriveRequest, clock: Clock, zero: Array, drives: Callable[[Driver, Person], None]
) -> bool:
    """Gets hold of a robot and has it driven; returns whether a signal ended that.

    A folder that was new, and in which nothing came of it, goes again.

    Args:
        request: Which robot, and for what folder.
        clock: Of this process.
        zero: What the joints report where the published arm is at zero, rad, shape (J,).
        drives: Drives it, with whoever watches.

    Raises:
        BadInputError: the robot cannot be what is asked for.
        UnreachableError: it does not answer.
    """
    fresh = not request.out.exists()
    try:
        with (
            robot_of(request, clock, zero) as (transport, idle),
            Keyboard() as keyboard,
            _signals() as stop,
        ):
            driver = Driver(transport, clock, idle)
            driver.begin(JOINT_NAMES, _WAIT_S)
            person = Person(key=keyboard.key, stopped=stop, say=_say, is_there=keyboard.is_there)
            with carrying(driver, request.payload):
                drives(driver, person)
            return stop()
    except BadInputError:
        if fresh and not (request.out / RESULT).exists():
            shutil.rmtree(request.out, ignore_errors=True)
        raise


@contextmanager
def _signals() -> Iterator[StopSignal]:
    """Turns SIGINT and SIGTERM into a flag meanwhile: the arm is stopped before anything else."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    stop = StopSignal()
    stop.install()
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(words: str) -> None:
    sys.stdout.write(f"{words}\n")
    sys.stdout.flush()


def _free_name(request: DriveRequest, clock: Clock, goal: int, trial: int) -> str:
    """Returns a name that no recording has: of one that was broken off, what there is stays."""
    name = f"{request.task}_{goal}_{trial}"
    if request.connect:  # the folder is the bridge's
        return f"{name}_{clock.utc_ns() // 1_000_000}"
    while any((request.out / "recordings").glob(f"{name}.mcap*")):
        name += "_again"
    return name


def _line(attempt: Attempt, number: int, request: DriveRequest, left_s: float) -> str:
    return (
        f"{number} of {request.goals * request.trials}: goal {attempt.goal + 1}: "
        f"{REASONS[Outcome[attempt.outcome.upper()]]} after "
        f"{attempt.steps * CONTROL_PERIOD_S:.1f} s, {attempt.place_m * 100.0:.1f} cm away "
        f"(left: {clock_face(left_s)})"
    )
