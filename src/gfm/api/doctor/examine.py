"""A whole examination, from what is given to lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import final

from rich.console import Console

from gfm.api.doctor import motion, names, signals
from gfm.api.doctor.duration import how_long
from gfm.api.doctor.lines import refusal, well
from gfm.api.models import Model, NominalModel, load_nominal
from gfm.api.recordings import Files, in_one_order, without_strangers
from gfm.api.refusals import check_one_robot, check_some_motion
from gfm.api.sources import Sources, check_different, check_once, expanded
from gfm.core import BadInputError, Trajectory
from gfm.recording import read_recording
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.report.checks import Check, can_begin, checks_html, checks_json, checks_table, total
from gfm.sim.passive import with_idle_drives
from gfm.sim.plant import make_plant

MODEL, FILES = "model", "recordings"
#: Characters of a line where the table is printed into a string.
_COLUMNS = 100


@final
@dataclass(frozen=True, kw_only=True, repr=False)
class Examination:
    """What was found of a model and recordings; shown as a table where it ends a notebook's cell.

    Attributes:
        checks: In the order in which to mend things.
    """

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether a diagnosis would begin."""
        return can_begin(self.checks)

    def document(self) -> dict[str, object]:
        """Returns the document "gfm.doctor/1", ready for JSON."""
        return checks_json(self.checks)

    def print(self, console: Console) -> None:
        """Prints one line a check, and what they come to."""
        console.print(checks_table(self.checks))
        console.print(total(self.checks), highlight=False)

    def __repr__(self) -> str:
        return f"<Examination: {total(self.checks)}>"

    def __str__(self) -> str:
        console = Console(file=StringIO(), width=_COLUMNS)
        with console.capture() as captured:
            self.print(console)
        return captured.get()

    def _repr_html_(self) -> str:
        return checks_html(self.checks)


def doctor(
    model: Model,
    recordings: Sources,
    *,
    actuators: str | None = None,
    holdout: Sources = (),
    joint_states: str = JOINT_STATES,
    command: str = COMMAND,
) -> Examination:
    """Returns what fits and what does not between a model and recordings, before anything runs.

    Nothing is raised about what is given: whatever a diagnosis would refuse is a line.

    Args:
        model: Path of MJCF or URDF, or an `MjSpec`, or what `gfm.load_nominal` made of it; a
            list of them for several kinds of command.
        recordings: Paths, folders, or what `gfm.load` returned.
        actuators: What joints without an actuator get, as of `gfm.load_nominal`.
        holdout: What errors would be measured on.
        joint_states: Topic of the measurements in files.
        command: Topic of the commands in files.
    """
    checks: list[Check] = []
    nominal = _model(model, actuators, checks)
    topics = joint_states, command
    training, held = (_files(one, topics, checks) for one in (recordings, holdout))
    if training or held:
        checks.append(well(FILES, f"{len(training) + len(held)} can be read"))
        checks += _together(nominal, training, held)
    if nominal is not None and training and can_begin(checks):
        checks.append(how_long(nominal, [run for _, run in in_one_order(training)]))
    return Examination(checks=tuple(checks))


def _model(model: Model, actuators: str | None, checks: list[Check]) -> NominalModel | None:
    try:
        nominal = load_nominal(model, actuators)
    except BadInputError as exc:
        checks.append(refusal(MODEL, exc))
        return None
    for kind, spec in nominal.specs.items():
        told = f"{len(list(spec.actuators))} actuators, {kind} commands"
        checks.append(well(MODEL, f"loads; {told}"))
    checks += [well(MODEL, line.partition(": ")[2]) for line in nominal.about]
    return nominal


def _files(source: Sources, topics: tuple[str, str], checks: list[Check]) -> Files:
    """Returns the recordings that can be read; of the others lines are added."""
    read: list[tuple[Path, Trajectory]] = []
    try:
        given = expanded(source)
        paths = [one for one in given if isinstance(one, Path)]
        check_once(paths)
    except BadInputError as exc:
        checks.append(refusal(FILES, exc))
        return []
    for one in given:
        if isinstance(one, Trajectory):
            read.append((Path(one.name), one))
            continue
        try:
            read.append((one, read_recording(one, joint_states=topics[0], command=topics[1])))
        except BadInputError as exc:
            checks.append(refusal(FILES, exc))
    return read


def _together(nominal: NominalModel | None, training: Files, held: Files) -> Iterator[Check]:
    """Yields what is to be said of recordings, as far as the ones before allow it."""
    try:
        files = in_one_order([*training, *held])
        check_one_robot(files)
        check_different([path for path, _ in files if path.is_file()])
        check_some_motion(files)
    except BadInputError as exc:
        yield refusal(FILES, exc)
        return
    rest = iter(files)
    training, held = (list(islice(rest, len(one))) for one in (training, held))
    yield from signals.rates(files)
    if training:
        yield from signals.recorded_time(training, held)
    yield from signals.overlap(files)
    if nominal is not None:
        yield from _with_model(nominal, training, held)


def _with_model(nominal: NominalModel, training: Files, held: Files) -> Iterator[Check]:
    files = [*training, *held]
    yield from names.left_out(nominal, files)
    runs, _ = without_strangers(nominal.specs, [run for _, run in files])
    files = [(path, run) for (path, _), run in zip(files, runs, strict=True)]
    yield from names.joint_names(nominal, files)
    yield from names.command_kinds(nominal, files)
    known = names.shared(nominal, files)
    if not known:
        return
    driven, runs = with_idle_drives(nominal.specs, [run for _, run in known])
    known = [(path, run) for (path, _), run in zip(known, runs, strict=True)]
    joints = known[0][1].joint_names
    plants = {kind: make_plant(spec, joints) for kind, spec in driven.items()}
    learned_from = [one for one in known if one[0] in {path for path, _ in training}]
    yield from signals.units(known, plants)
    yield from signals.quality(known, plants)
    yield from motion.ranges(known, plants)
    yield from motion.control_ranges(known, plants)
    yield from motion.contacts(known, plants)
    if learned_from:
        yield from motion.seen(learned_from, plants, tuple(nominal.paths.values()))
