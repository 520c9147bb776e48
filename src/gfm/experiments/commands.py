"""The flags of `gfm run` and `gfm diagnose`; what they do is imported when it is done."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from gfm.core import ConfigError
from gfm.experiments.model_flags import GIVEN, MODEL, add_actuators, add_guess, add_topics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gfm.api.models import NominalModel
    from gfm.core import Trajectory

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_RUN = """\
Closes the loop once on this machine, with real services as processes of their own: drives a
simulated Sawyer and records it, measures how far its nominal model is off, identifies gains and
dampings (the usual answer), diagnoses which effect the model lacks, learns generalized forces for
the rest, and reports all of it. The robot hides an effect that is revealed after the verdict.
"""
_DIAGNOSE = """\
Finds what a MuJoCo model lacks to explain recordings of the robot that it stands for: names the
missing effect, says how large it is and how sure that is, and writes a corrected model.
"""
_PAIR = "MODEL.effects.json beside it is read as part of it"
_DIAGNOSE_END = """\
Recordings are MCAP files with sensor_msgs/msg/JointState on both topics (`gfm import` makes them
from tables, ROS bags and LeRobot datasets). The model has one actuator per joint, of the kind of
the commands: position servo, velocity servo or motor. --actuators adds missing ones; the model with
them is written to nominal.xml. The corrected model is written to corrected.xml, and effects that
MJCF cannot express to corrected.effects.json beside it. Commands that are given corrected.xml read
both. For several models corrected_KIND.xml is written, too. With --since the report begins with
what changed, and ranges.toml says from which ranges training should draw.
Exit status: 0 a verdict was reached, 2 bad input.
"""


def add_run_parser(subparsers: Subparsers) -> None:
    """Adds `gfm run`."""
    parser = subparsers.add_parser(
        "run", help="close the whole loop once on this machine", description=_RUN
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of everything random (default: %(default)s)"
    )
    parser.add_argument(
        "--hidden-effect",
        default="random",
        metavar="NAME",
        help="what the robot hides: random, none, or an effect (default: %(default)s)",
    )
    parser.add_argument(
        "--skip-gfm", action="store_true", help="leave out learning generalized forces"
    )
    parser.add_argument("--skip-task", action="store_true", help="leave out the loop on a task")
    parser.add_argument(
        "--actors", type=int, default=2, metavar="N", help="actor processes (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="a new folder for everything (default: runs/TIME)"
    )
    parser.add_argument(
        "--budget-minutes",
        type=float,
        default=9.5,
        metavar="MINUTES",
        help="for the whole run; learning takes what the rest leaves (default: %(default)s)",
    )
    parser.add_argument(
        "--motion-s",
        type=float,
        default=12.0,
        metavar="SECONDS",
        help="length of each of the ten motions (default: %(default)s)",
    )
    parser.add_argument(
        "--model",
        dest="models",
        action="append",
        default=[],
        type=Path,
        metavar="MODEL.xml",
        help="MJCF of the nominal arm, once for position and once for velocity commands (default: "
        f"the published one); {_PAIR}",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Closes the loop."""
    from gfm.experiments.run_settings import RunSettings

    settings = RunSettings(
        folder=arguments.out or Path("runs") / time.strftime("%Y%m%d-%H%M%S"),
        seed=arguments.seed,
        hidden_effect=arguments.hidden_effect,
        skip_gfm=arguments.skip_gfm,
        skip_task=arguments.skip_task,
        actors=arguments.actors,
        budget_s=60.0 * arguments.budget_minutes,
        motion_s=arguments.motion_s,
        models=tuple(arguments.models),
    )
    from gfm.experiments.run import close_the_loop

    close_the_loop(settings, Console())
    return 0


def add_diagnose_parser(subparsers: Subparsers) -> None:
    """Adds `gfm diagnose`."""
    parser = subparsers.add_parser(
        "diagnose",
        help="find what a model lacks to explain recordings",
        description=_DIAGNOSE,
        epilog=_DIAGNOSE_END,
    )
    parser.add_argument(
        "recordings", nargs="+", type=Path, metavar="RECORDING", help="MCAP file to learn from"
    )
    parser.add_argument(
        "--model",
        dest="models",
        action="append",
        required=True,
        type=Path,
        metavar=MODEL,
        help=f"{GIVEN}; once per kind of command in the recordings; {_PAIR}",
    )
    add_actuators(parser)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for report and corrected model",
    )
    parser.add_argument(
        "--holdout",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="RECORDING",
        help="what errors are measured on (default: the last recording, or the end of a lone one)",
    )
    add_guess(
        parser, "RECORDING may be any file that `gfm import` reads, by the mapping that it offers"
    )
    add_topics(parser)
    parser.add_argument(
        "--gfm",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="FORCES.npz",
        help="learned forces to name, too (checkpoints/forces.npz of a run); several are averaged",
    )
    parser.add_argument(
        "--since",
        nargs="+",
        action="append",
        type=Path,
        default=[],
        metavar="RECORDING",
        help="an earlier set of recordings: what changed since then? Once per set, oldest first",
    )
    parser.add_argument("--seed", type=int, default=0, help="only written to the report")
    parser.add_argument(
        "--minutes",
        type=float,
        default=10.0,
        help="longest time to an answer; the search gets 85 %% of it (default: %(default)g)",
    )
    parser.add_argument(
        "--keep-suspects",
        action="store_true",
        help="keep effects in corrected.xml that are more likely wrong than right",
    )
    parser.add_argument(
        "--no-film",
        dest="film",
        action="store_false",
        help="leave out the film of robot and model (it takes about 10 s; extra `video`), and with "
        "the extra `rerun` motion.rrd",
    )
    parser.set_defaults(run=run_diagnose)


def run_diagnose(arguments: argparse.Namespace) -> int:
    """Diagnoses recordings."""
    from gfm.api.diagnosis import DiagnoseRequest
    from gfm.api.models import load_nominal
    from gfm.api.provenance import command_line
    from gfm.experiments.diagnose_command import diagnose_files

    model = load_nominal(arguments.models, arguments.actuators)
    request = DiagnoseRequest(
        model=model,
        recordings=_sources(arguments, model, arguments.recordings),
        holdout=_sources(arguments, model, arguments.holdout),
        joint_states=arguments.joint_states,
        command=arguments.command,
        seed=arguments.seed,
        gfm=tuple(arguments.gfm),
        minutes=arguments.minutes,
        keep_suspects=arguments.keep_suspects,
        since=[_sources(arguments, model, one) for one in arguments.since],
        words=command_line(),
    )
    progress = Console(file=sys.stderr)
    diagnose_files(request, arguments.out, Console(), progress, film=arguments.film)
    return 0


def _sources(
    arguments: argparse.Namespace, model: NominalModel, paths: Sequence[Path]
) -> Sequence[Path | Trajectory]:
    """Returns what is to be diagnosed: paths of recordings; with --yes what their files hold."""
    from gfm.api.sources import load

    guessed = [
        flag for flag, value in (("--use", arguments.use), ("--unit", arguments.unit)) if value
    ]
    if guessed and not arguments.yes:
        raise ConfigError(f"{guessed[0]}; expected --yes, to read files of other tools")
    if not arguments.yes or not paths:
        return paths
    return load(
        paths,
        model=model,
        use=arguments.use,
        unit=arguments.unit,
        joint_states=arguments.joint_states,
        command=arguments.command,
        report=sys.stdout.write,
    )
