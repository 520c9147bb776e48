"""The command `gfm import`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.core import BadInputError, ConfigError, Trajectory
from gfm.experiments.model_flags import GIVEN, MODEL, add_actuators, add_guess

if TYPE_CHECKING:
    from gfm.importing.mapping import Mapping

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Turns what other tools wrote into recordings that `gfm diagnose` reads: tables (CSV, JSON, Parquet,
NumPy's .npz, MATLAB's .mat; also .tsv, .txt, .jsonl and .gz), ROS bags (rosbag2, rosbag1) and
LeRobot datasets (v2, v3). The mapping, a TOML file, says which column is which signal:
docs/recordings.md describes it, models/mappings/ has three to start from. With --model instead, a
mapping is guessed from the first FILE and printed with a reason for every line; --yes imports with
it.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm import`."""
    parser = subparsers.add_parser(
        "import", help="turn files of other tools into recordings", description=_DESCRIPTION
    )
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="table, bag or dataset to import"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--mapping", type=Path, metavar="TOML", help="which column is which signal")
    which.add_argument(
        "--model", type=Path, metavar=MODEL, help=f"guess the mapping from its joints: {GIVEN}"
    )
    add_actuators(parser)
    add_guess(parser, "import with the guessed mapping")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to write")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Reads everything first, so that bad input leaves nothing behind; then writes."""
    from gfm.importing import imported

    mapping = _mapping(arguments)
    if arguments.model is not None and not arguments.yes:
        sys.stderr.write("nothing was imported: save this as a mapping, or add --yes --out DIR\n")
        return 0
    if arguments.out is None:
        raise ConfigError("no --out given; expected a folder to write to")
    trajectories = list(imported(arguments.files, mapping))
    if arguments.out.exists() and not arguments.out.is_dir():
        raise BadInputError(f"{arguments.out}: is a file; expected a folder to write to")
    _write(arguments.out, trajectories)
    return 0


def _mapping(arguments: argparse.Namespace) -> Mapping:
    """Returns the mapping that was given, or guesses and prints one."""
    from gfm.importing import load_mapping

    flags = {
        "--yes": arguments.yes,
        "--use": arguments.use,
        "--unit": arguments.unit,
        "--actuators": arguments.actuators,
    }
    given = [flag for flag, value in flags.items() if value]
    if given and arguments.model is None:
        raise ConfigError(f"{', '.join(given)}; expected --model MODEL, to guess a mapping from")
    if arguments.mapping is not None:
        return load_mapping(arguments.mapping)
    if arguments.model is None:
        expected = "one, or --model MODEL, which guesses it"
        saves = "`gfm recording salvage` saves a recording that was cut off"
        raise ConfigError(f"no --mapping given; expected {expected} ({saves})")
    return _offered(arguments)


def _offered(arguments: argparse.Namespace) -> Mapping:
    """Guesses a mapping, and prints it."""
    from gfm.api.models import load_nominal
    from gfm.api.sources import mapping_for
    from gfm.importing import mapping_of
    from gfm.importing.guess import Asked

    asked = Asked(use=tuple(arguments.use), unit=arguments.unit)
    model = load_nominal(arguments.model, arguments.actuators)
    text = mapping_for(arguments.files[0], model, asked)
    sys.stdout.write(text)
    return mapping_of(text, "the guessed mapping")


def _write(out: Path, trajectories: Sequence[Trajectory]) -> None:
    from gfm.recording import write_recording

    for trajectory in trajectories:
        path = out / f"{trajectory.name}.mcap"
        write_recording(path, trajectory)
        sys.stdout.write(f"{path}: {_summary(trajectory)}\n")
        for line in _copies(trajectory):
            sys.stderr.write(f"warning: {path}: {line}\n")


def _summary(trajectory: Trajectory) -> str:
    joints = ", ".join(trajectory.joint_names)
    return (
        f"{trajectory.duration_s:.1f} s, {len(trajectory.stamp_ns)} measurements, "
        f"{len(trajectory.command_stamp_ns)} {trajectory.command_kind} commands, joints {joints}"
    )


def _copies(trajectory: Trajectory) -> Iterator[str]:
    """Yields a warning where commands are the measurements themselves."""
    from gfm.signals.echoes import echoed

    found = echoed(trajectory)
    if found:
        least = min(one.value for one in found)
        joints = ", ".join(str(one.joint) for one in found)
        yield (
            f"the command of {joints} is a copy of what was measured: on {least:.0f} % of the rows "
            "in motion or more it equals a measurement at most two rows away; expected what the "
            "robot was told"
        )
