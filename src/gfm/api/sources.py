"""Recordings as a program names them: files, folders, values, and files of other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeAlias

import mujoco

from gfm.api.models import Model, load_nominal
from gfm.api.provenance import sha256
from gfm.api.recordings import Files, in_one_order
from gfm.core import ConfigError, RecordingError, Trajectory
from gfm.importing import imported, load_mapping, mapping_of
from gfm.importing.formats import ALSO_NAMED, TABLE_FORMATS
from gfm.importing.guess import Asked, Robot, guessed_mapping
from gfm.recording import read_recording
from gfm.recording.mcap_file import read_mcap
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.sim.drive_names import driven_joints

#: A recording as it may be named: a file, a folder of them, or a value.
Source: TypeAlias = str | Path | Trajectory
Sources: TypeAlias = Source | Sequence[Source]

RECORDING = ".mcap"
#: Of a folder's files. A .txt beside recordings is mostly no table, and is read where it is named.
_TABLES = tuple(f".{name}" for name in (*TABLE_FORMATS, *ALSO_NAMED) if name != "txt")
_FOREIGN = (*_TABLES, ".gz", ".bag", ".db3")


def load(
    source: Sources,
    *,
    model: Model | None = None,
    mapping: str | Path | None = None,
    use: Sequence[str] = (),
    unit: str | None = None,
    joint_states: str = JOINT_STATES,
    command: str = COMMAND,
    report: Callable[[str], object] = lambda _: None,
) -> list[Trajectory]:
    """Returns recordings: positions in rad, velocities in rad/s, efforts in N m, stamps in ns.

    Args:
        source: MCAP recordings, a folder of them, or, with `model` or `mapping`, files of other
            tools (tables, ROS bags, LeRobot datasets), as `gfm import` reads them.
        model: Its joints say how files of other tools are to be read; the mapping is guessed from
            the first of them.
        mapping: TOML file that says which column is which signal; nothing is guessed then.
        use: For the guess: topics, or beginnings of columns' names, to take where several fit, or
            words in them ("left").
        unit: For the guess: "rad", "degrees" or "normalised", where sizes do not tell.
        joint_states: Topic of the measurements in MCAP recordings.
        command: Topic of the commands there.
        report: Told the mapping that was guessed, with a reason for every line: `report=print`.

    Raises:
        BadInputError: something cannot be read; the message says what and where.
    """
    if model is not None and mapping is not None:
        raise ConfigError("both model and mapping are given; expected one of them to read by")
    paths = list(_paths(source, foreign=model is not None or mapping is not None))
    if not paths:
        raise ConfigError("no recordings; expected at least one")
    if mapping is not None:
        return list(imported(paths, load_mapping(Path(mapping))))
    if model is None and paths[0].suffix in _FOREIGN:
        expected = (
            "model=..., to guess how it is to be read, or mapping=..., a TOML file that says so"
        )
        raise ConfigError(f"{paths[0]}: is another tool's; expected {expected}")
    if model is None or _is_recording(paths[0], {joint_states, command}):
        return [read_recording(path, joint_states=joint_states, command=command) for path in paths]
    text = mapping_for(paths[0], model, Asked(use=tuple(use), unit=unit))
    report(text)
    return list(imported(paths, mapping_of(text, "the guessed mapping")))


def _is_recording(path: Path, topics: set[str]) -> bool:
    """Returns whether a file is a recording, and not another tool's bag."""
    return path.suffix == RECORDING and topics <= set(read_mcap(path, {}).topics)


def mapping_for(path: Path, model: Model, asked: Asked) -> str:
    """Returns the mapping that fits a file to a model, as TOML with a reason for every line.

    Raises:
        BadInputError: the file or the model cannot be read, or several things fit.
    """
    ((kind, spec),) = load_nominal(model).specs.items()
    compiled = spec.copy().compile()
    joints = driven_joints(compiled)
    limited = [name for name in joints if compiled.joint(name).limited[0]]
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    robot = Robot(
        joints=joints,
        command_kind=kind,
        ranges={n: (float(r[0]), float(r[1])) for n in limited for r in [compiled.joint(n).range]},
        slides=frozenset(name for name in joints if compiled.joint(name).type[0] == slide),
    )
    return guessed_mapping(path, robot, asked)


def read_files(
    source: Sources, *, joint_states: str = JOINT_STATES, command: str = COMMAND
) -> Files:
    """Returns recordings with where they came from; joints are in the order of the first one's.

    A value came from its name.

    Raises:
        RecordingError: a file cannot be trusted, or has other joints than the first.
    """

    def read(one: Path | Trajectory) -> tuple[Path, Trajectory]:
        if isinstance(one, Trajectory):
            return Path(one.name), one
        return one, read_recording(one, joint_states=joint_states, command=command)

    return in_one_order([read(one) for one in expanded(source)])


def expanded(source: Sources, *, foreign: bool = False) -> list[Path | Trajectory]:
    """Returns files and values, one by one; a folder stands for the recordings in it.

    Args:
        source: As named.
        foreign: Whether files of other tools count: of a folder, all of a kind that is known.

    Raises:
        RecordingError: a folder has no recording in it.
    """
    listed = [source] if isinstance(source, str | Path | Trajectory) else source
    found: list[Path | Trajectory] = []
    for one in listed:
        if isinstance(one, Trajectory):
            found.append(one)
        else:
            found += _files_of(Path(one), foreign=foreign)
    return found


def _paths(source: Sources, *, foreign: bool) -> Iterable[Path]:
    for one in expanded(source, foreign=foreign):
        if isinstance(one, Trajectory):
            raise ConfigError(f"{one.name} is a recording already; expected a file or a folder")
        yield one


def _files_of(path: Path, *, foreign: bool) -> list[Path]:
    if not path.is_dir() or (foreign and _is_one_source(path)):
        return [path]
    kinds = (RECORDING, *_FOREIGN) if foreign else (RECORDING,)
    files = sorted(one for one in path.iterdir() if one.suffix in kinds)
    if not files:
        raise RecordingError(
            str(path), f"no file in it ends with {', '.join(kinds)}", "a folder of recordings"
        )
    return files


def _is_one_source(folder: Path) -> bool:
    """Returns whether a folder is a rosbag2 or a LeRobot dataset."""
    return (folder / "metadata.yaml").is_file() or (folder / "meta").is_dir()


def check_different(paths: Sequence[Path]) -> None:
    """Raises ConfigError where two files have the same content."""
    seen: dict[str, Path] = {}
    for path in paths:
        before = seen.setdefault(sha256(path), path)
        if before is not path:
            raise ConfigError(f"{before} and {path} are the same; expected different recordings")


def check_once(paths: Sequence[Path]) -> None:
    """Raises ConfigError where a file is named twice."""
    resolved = [path.resolve() for path in paths]
    twice = [path for i, path in enumerate(paths) if resolved[i] in resolved[:i]]
    if twice:
        raise ConfigError(f"{twice[0]}: given twice; expected different recordings")
