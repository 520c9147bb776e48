"""What `gfm diagnose` does: recordings and a model in, a verdict out."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from rich.console import Console
from rich.text import Text

from gfm.api.folders import check_folder
from gfm.api.models import load_nominal
from gfm.api.provenance import command_line, provenance, sha256
from gfm.api.recordings import check_together, read_recordings, split, without_strangers
from gfm.api.refusals import check_usable
from gfm.core import ConfigError
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Diagnosis
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.report import print_diagnosis, write_diagnosis
from gfm.report.files import forget_effects
from gfm.service.force_files import read_forces
from gfm.sim.learned import LearnedForces
from gfm.sim.learned_along import check_robot


@dataclass(frozen=True, kw_only=True)
class DiagnoseRequest:
    """What is to be diagnosed.

    Attributes:
        recordings: What effects are looked for in.
        holdout: What errors are measured on; empty to split that off the recordings.
        models: One MJCF file per kind of command.
        out: Folder to write to.
        joint_states: Topic of the measurements.
        command: Topic of the commands.
        seed: Of everything random; the diagnosis has nothing random today, and says so.
        gfm: Fitted force models, whose forces are to be named.
        minutes: After which the search ends with its best answer so far.
        keep_suspects: Whether what is more likely wrong than right stays in the corrected model.
        since: Earlier sets of recordings, oldest first, since which changes are told.
    """

    recordings: tuple[Path, ...]
    holdout: tuple[Path, ...]
    models: tuple[Path, ...]
    out: Path
    joint_states: str = JOINT_STATES
    command: str = COMMAND
    seed: int = 0
    gfm: tuple[Path, ...] = ()
    minutes: float = float("inf")
    keep_suspects: bool = False
    since: tuple[tuple[Path, ...], ...] = ()

    @property
    def files(self) -> list[Path]:
        """All recordings: of now, held out, and of each earlier set."""
        return [*self.recordings, *self.holdout, *(path for one in self.since for path in one)]

    def __post_init__(self) -> None:
        check_folder(self.out)
        if not self.minutes > 0.0:
            raise ConfigError(f"--minutes is {self.minutes:g}, expected more than 0")
        given = self.files
        twice = [path for i, path in enumerate(given) if path.resolve() in _resolved(given[:i])]
        if twice:
            raise ConfigError(f"{twice[0]}: given twice; expected different recordings")


def diagnose_files(request: DiagnoseRequest, answer: Console, progress: Console) -> None:
    """Reads, diagnoses, writes and prints.

    Args:
        request: What.
        answer: Gets the verdict.
        progress: Told what is happening.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
    """
    diagnosis = _diagnosed(request, progress)
    paths = write_whole(request.out, diagnosis)
    print_diagnosis(answer, diagnosis)
    for path in paths:
        answer.print(Text(str(path)), soft_wrap=True)


def _diagnosed(request: DiagnoseRequest, progress: Console) -> Diagnosis:
    nominal = load_nominal(request.models)
    say = partial(_say, progress, time.monotonic())
    for line in nominal.about:
        say(line)
    paths = request.files
    recordings = read_recordings(paths, joint_states=request.joint_states, command=request.command)
    check_different(paths)
    recordings, notes = without_strangers(nominal.specs, recordings)
    check_together(nominal.specs, list(zip(paths, recordings, strict=True)))
    read = zip(paths, recordings, strict=True)
    sets = (request.recordings, request.holdout, *request.since)
    now, held, *since = (list(islice(read, len(one))) for one in sets)
    check_usable(nominal.specs, now, held)
    for earlier in since:
        check_usable(nominal.specs, earlier, [])
    learned = _read_learned(request.gfm, recordings[0].joint_names)
    training, holdout = ([run for _, run in one] for one in (now, held))
    if not holdout:
        training, holdout, note = split(training)
        notes.append(note)
    files = {
        "model": nominal.files,
        "recording": request.recordings,
        "held-out recording": request.holdout,
        "earlier recording": [path for one in request.since for path in one],
        "force model": request.gfm,
    }
    return diagnose(
        nominal.specs,
        training,
        holdout,
        report=say,
        provenance=provenance(files, request.seed, command_line()),
        notes=notes,
        given=nominal.effects,
        learned=learned,
        time_left=_clock(request.minutes),
        keep_suspects=request.keep_suspects,
        since=[[run for _, run in one] for one in since],
    )


def _clock(minutes: float) -> Callable[[], float]:
    """Returns what tells which share of the minutes from now on is left."""
    end_s = time.monotonic() + 60.0 * minutes
    return lambda: (end_s - time.monotonic()) / (60.0 * minutes)


def _read_learned(paths: Sequence[Path], joints: tuple[str, ...]) -> list[LearnedForces]:
    """Returns the force models in files.

    Raises:
        BadInputError: one of them cannot be read, or was fitted to another robot.
    """
    learned = []
    for path in paths:
        forces = read_forces(path)
        try:
            check_robot(forces, joints)
        except ConfigError as exc:
            raise ConfigError(f"{path}: {exc}") from exc
        learned.append(forces)
    return learned


def _say(progress: Console, began_s: float, words: str) -> None:
    """Tells what is happening, and how many seconds after the beginning."""
    seconds = f"{time.monotonic() - began_s:6.1f} s"
    progress.print(Text(f"{seconds}  {words}", style="dim"), soft_wrap=True)


def check_different(paths: Sequence[Path]) -> None:
    """Raises ConfigError where two files have the same content."""
    seen: dict[str, Path] = {}
    for path in paths:
        before = seen.setdefault(sha256(path), path)
        if before is not path:
            raise ConfigError(f"{before} and {path} are the same; expected different recordings")


def _resolved(paths: Sequence[Path]) -> list[Path]:
    return [path.resolve() for path in paths]


def write_whole(out: Path, diagnosis: Diagnosis) -> tuple[Path, ...]:
    """Writes the files of a diagnosis beside `out` first, then moves them there."""
    out.absolute().parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.absolute().parent))
    try:
        written = write_diagnosis(part, diagnosis)
        out.mkdir(exist_ok=True)
        for path in written:
            forget_effects(out / path.name)
        return tuple(path.replace(out / path.name) for path in written)
    finally:
        shutil.rmtree(part)
