"""A diagnosis, from what is given to an answer: what `gfm.diagnose` and `gfm diagnose` do."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

from gfm.api.answer import Diagnosis
from gfm.api.models import Model, NominalModel, load_nominal
from gfm.api.provenance import provenance
from gfm.api.recordings import Files, check_together, split, without_strangers
from gfm.api.refusals import check_usable
from gfm.api.sources import Sources, check_different, check_once, expanded, read_files
from gfm.core import ConfigError, Trajectory
from gfm.diagnosis import diagnose as science
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.service.force_files import read_forces
from gfm.sim.learned import LearnedForces
from gfm.sim.learned_along import check_robot

#: Share of the time in which effects are looked for; what is left is for their last amounts, for
#: errors on held-out recordings, and for pictures.
SEARCHING = 0.85
#: Told what is happening, in words.
Say: TypeAlias = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class DiagnoseRequest:
    """What is to be diagnosed.

    Attributes:
        model: Of the robot.
        recordings: What effects are looked for in.
        holdout: What errors are measured on; empty to split that off the recordings.
        joint_states: Topic of the measurements.
        command: Topic of the commands.
        seed: Of everything random; the diagnosis has nothing random today, and says so.
        gfm: Files of fitted force models, whose forces are to be named.
        minutes: After which the search ends with its best answer so far.
        keep_suspects: Whether what is more likely wrong than right stays in the corrected model.
        since: Earlier sets of recordings, oldest first, since which changes are told.
        words: What asked, for the report.
    """

    model: Model
    recordings: Sources
    holdout: Sources = ()
    joint_states: str = JOINT_STATES
    command: str = COMMAND
    seed: int = 0
    gfm: tuple[Path, ...] = ()
    minutes: float = 10.0
    keep_suspects: bool = False
    since: Sequence[Sources] = ()
    words: Sequence[str] = ("gfm.diagnose",)

    def __post_init__(self) -> None:
        if not self.minutes > 0.0:
            raise ConfigError(f"minutes is {self.minutes:g}, expected more than 0")

    @property
    def sets(self) -> dict[str, list[list[Path | Trajectory]]]:
        """All recordings, one by one, in sets, by role.

        Raises:
            BadInputError: there is none, one is named twice, or a folder has none in it.
        """
        sets = {
            "recording": [expanded(self.recordings)],
            "held-out recording": [expanded(self.holdout)],
            "earlier recording": [expanded(one) for one in self.since],
        }
        if not sets["recording"][0]:
            raise ConfigError("no recordings; expected at least one")
        check_once(_paths(_flat(sets)))
        return sets


def diagnose(
    model: Model,
    recordings: Sources,
    *,
    holdout: Sources = (),
    since: Sequence[Sources] = (),
    minutes: float = 10.0,
    keep_suspects: bool = False,
    joint_states: str = JOINT_STATES,
    command: str = COMMAND,
    report: Say = lambda _: None,
) -> Diagnosis:
    """Returns what a model lacks to explain recordings of the robot that it stands for.

    Args:
        model: Path of MJCF or URDF, or an `MjSpec`, or what `gfm.load_nominal` made of it; a
            list of them for several kinds of command.
        recordings: What effects are looked for in: paths, folders, or what `gfm.load` returned.
        holdout: What errors are measured on; by default the last recording, or the end of a
            lone one.
        since: Earlier sets of recordings, oldest first: what changed since then?
        minutes: For the answer; effects are looked for in the first 85 % of them.
        keep_suspects: Whether effects that are more likely wrong than right stay in the model.
        joint_states: Topic of the measurements in files.
        command: Topic of the commands in files.
        report: Told what is happening, in words: `report=print`.

    Raises:
        BadInputError: something given cannot be used; the message says what, where, and what was
            expected.
    """
    request = DiagnoseRequest(
        model=model,
        recordings=recordings,
        holdout=holdout,
        since=since,
        minutes=minutes,
        keep_suspects=keep_suspects,
        joint_states=joint_states,
        command=command,
    )
    return diagnosed(request, report)


def diagnosed(request: DiagnoseRequest, report: Say) -> Diagnosis:
    """Returns the answer to a request; arguments and errors as of `diagnose`."""
    sets = request.sets
    nominal = load_nominal(request.model)
    for line in nominal.about:
        report(line)
    files, notes = _read(request, nominal, _flat(sets))
    rest = iter(files)
    now, held, *since = (list(islice(rest, len(one))) for one in chain(*sets.values()))
    check_usable(nominal.specs, now, held)
    for earlier in since:
        check_usable(nominal.specs, earlier, [])
    training, holdout = ([run for _, run in one] for one in (now, held))
    learned = _read_learned(request.gfm, training[0].joint_names)
    if not holdout:
        training, holdout, note = split(training)
        notes.append(note)
    answer = science.diagnose(
        nominal.specs,
        training,
        holdout,
        report=report,
        provenance=_provenance(request, nominal, sets),
        notes=notes,
        given=nominal.effects,
        learned=learned,
        time_left=_clock(request.minutes),
        keep_suspects=request.keep_suspects,
        since=[[run for _, run in one] for one in since],
    )
    return Diagnosis(answer=answer, nominal=nominal)


def _read(
    request: DiagnoseRequest, nominal: NominalModel, given: Sequence[Path | Trajectory]
) -> tuple[Files, list[str]]:
    """Returns recordings that fit the models and each other, and what to know of them."""
    read = read_files(given, joint_states=request.joint_states, command=request.command)
    check_different(_paths(given))
    runs, notes = without_strangers(nominal.specs, [run for _, run in read])
    files = [(path, run) for (path, _), run in zip(read, runs, strict=True)]
    check_together(nominal.specs, files)
    return files, notes


def _flat(sets: Mapping[str, Sequence[Sequence[Path | Trajectory]]]) -> list[Path | Trajectory]:
    return [one for of_role in sets.values() for listed in of_role for one in listed]


def _paths(given: Iterable[Path | Trajectory]) -> list[Path]:
    return [one for one in given if isinstance(one, Path)]


def _provenance(
    request: DiagnoseRequest,
    nominal: NominalModel,
    sets: Mapping[str, Sequence[Sequence[Path | Trajectory]]],
) -> dict[str, object]:
    files = {
        "model": nominal.files,
        **{role: _paths(chain(*listed)) for role, listed in sets.items()},
        "force model": request.gfm,
    }
    told = provenance(files, request.seed, request.words)
    in_memory = {
        role: [one.name for one in chain(*listed) if isinstance(one, Trajectory)]
        for role, listed in sets.items()
    }
    return told | ({"in_memory": in_memory} if any(in_memory.values()) else {})


def _clock(minutes: float) -> Callable[[], float]:
    """Returns what tells which share of the time for searching is left, from now on."""
    search_s = SEARCHING * 60.0 * minutes
    end_s = time.monotonic() + search_s
    return lambda: (end_s - time.monotonic()) / search_s


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
