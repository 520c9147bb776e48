"""The command `gfm recording`: what is in recordings, whether they can be used, parts of them."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from gfm.core import BadInputError
from gfm.recording.new_file import new_file
from gfm.recording.schemas import COMMAND, JOINT_STATES

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Looks into recordings. Times are in seconds since the first measurement. Nothing is overwritten: a
name that exists is refused, and a file gets its name when it is whole.
"""
_FORMATS = ("csv", "parquet", "npz")


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm recording`."""
    summary = "look into recordings, check, cut, export, save"
    parser = subparsers.add_parser("recording", help=summary, description=_DESCRIPTION)
    tools = parser.add_subparsers(title="tools", metavar="TOOL", required=True)
    _add_info(tools)
    _add_check(tools)
    _add_plot(tools)
    _add_cut(tools)
    _add_export(tools)
    _add_salvage(tools)


def _add_info(tools: Subparsers) -> None:
    parser = tools.add_parser("info", help="say what is in them")
    _add_files(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object for each line")
    parser.set_defaults(run=_info)


def _add_check(tools: Subparsers) -> None:
    parser = tools.add_parser(
        "check",
        help="say whether they can be used; ends with 2 if one cannot",
        description="Says of each recording whether it is fit, doubtful or unfit, and why.",
    )
    _add_files(parser, "recording, or a folder of them (with the parts that a crash left)")
    parser.set_defaults(run=_check)


def _add_plot(tools: Subparsers) -> None:
    parser = tools.add_parser("plot", help="draw one as an HTML page that needs nothing beside it")
    _add_file(parser)
    parser.add_argument("--out", type=Path, metavar="PAGE.html", help="(default: FILE's, .html)")
    parser.set_defaults(run=_plot)


def _add_cut(tools: Subparsers) -> None:
    parser = tools.add_parser("cut", help="make a recording of a part of one, with all topics")
    _add_file(parser)
    parser.add_argument("--from", type=float, default=-math.inf, metavar="S", dest="begin_s")
    parser.add_argument("--to", type=float, default=math.inf, metavar="S", dest="end_s")
    parser.add_argument("--out", type=Path, required=True, metavar="NEW.mcap")
    parser.set_defaults(run=_cut)


def _add_export(tools: Subparsers) -> None:
    parser = tools.add_parser(
        "export",
        help="write one as tables, with units in the names",
        description="csv and parquet: one file for measurements, one for commands, one for an "
        "object's poses. npz: one file.",
    )
    _add_file(parser)
    parser.add_argument("--format", choices=_FORMATS, default="csv", help="(default: csv)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.set_defaults(run=_export)


def _add_salvage(tools: Subparsers) -> None:
    parser = tools.add_parser(
        "salvage",
        help="make a whole recording of what is readable of a damaged one",
        description="Saves what a crash left (NAME.mcap.part), or what is undamaged of a file, "
        "with all topics, and says what was lost. FILE stays as it is.",
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument(
        "--out", type=Path, metavar="NEW.mcap", help="(default: NAME_salvaged.mcap beside FILE)"
    )
    parser.set_defaults(run=_salvage)


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="recording")
    _add_topics(parser)


def _add_files(parser: argparse.ArgumentParser, what: str = "recording") -> None:
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=what)
    _add_topics(parser)


def _add_topics(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--joint-states", default=JOINT_STATES, metavar="TOPIC")
    parser.add_argument("--command", default=COMMAND, metavar="TOPIC")


class _Topics(TypedDict):
    joint_states: str
    command: str


def _topics(arguments: argparse.Namespace) -> _Topics:
    return {"joint_states": arguments.joint_states, "command": arguments.command}


def _info(arguments: argparse.Namespace) -> None:
    from gfm.experiments.recording_words import overview_lines
    from gfm.recording.overview import overview

    for path in arguments.files:
        seen = overview(path, **_topics(arguments))
        text = json.dumps(seen.as_json()) if arguments.json else "\n".join(overview_lines(seen))
        sys.stdout.write(f"{text}\n")


def _check(arguments: argparse.Namespace) -> None:
    from gfm.experiments.recording_check import files_of, judged

    judgements = [judged(path, **_topics(arguments)) for path in files_of(arguments.files)]
    for one in judgements:
        sys.stdout.write(f"{one.path}: {one.verdict}\n")
        for label, lines in (("unfit", one.unfit), ("doubtful", one.doubtful), ("", one.notes)):
            for line in lines:
                sys.stdout.write(f"  {label or 'note'}: {line}\n")
    unfit = [one for one in judgements if one.unfit]
    if len(judgements) == 1 and unfit:
        raise BadInputError(f"{unfit[0].path}: {unfit[0].unfit[0]}")
    if unfit:
        names = ", ".join(str(one.path) for one in unfit)
        raise BadInputError(f"{len(unfit)} of {len(judgements)} recordings are unfit: {names}")


def _plot(arguments: argparse.Namespace) -> None:
    from gfm.experiments.recording_words import delay_counts
    from gfm.recording import read_recording
    from gfm.recording.punctuality import punctuality
    from gfm.recording.raw import read_raw
    from gfm.report.recording import recording_html

    recording = read_recording(arguments.file, **_topics(arguments))
    page = recording_html(recording, delay_counts(punctuality(read_raw(arguments.file))))
    out = arguments.out or arguments.file.with_suffix(".html")
    with new_file(out) as place:
        place.write_text(page, encoding="utf-8")
    sys.stdout.write(f"{out}\n")


def _cut(arguments: argparse.Namespace) -> None:
    from gfm.recording.cut import cut

    part = cut(
        arguments.file,
        arguments.out,
        begin_s=arguments.begin_s,
        end_s=arguments.end_s,
        **_topics(arguments),
    )
    counts = ", ".join(f"{len(of)} on {topic}" for topic, of in part.by_topic().items() if of)
    sys.stdout.write(f"{arguments.out}: {counts}\n")


def _export(arguments: argparse.Namespace) -> None:
    from gfm.recording import read_recording
    from gfm.recording.export import export

    recording = read_recording(arguments.file, **_topics(arguments))
    for path in export(recording, arguments.out, arguments.format):
        sys.stdout.write(f"{path}\n")


def _salvage(arguments: argparse.Namespace) -> None:
    from gfm.recording.salvage import salvage

    path = arguments.file
    name = path.name.removesuffix(".part").removesuffix(".mcap")
    out = arguments.out or path.with_name(f"{name}_salvaged.mcap")
    saved = salvage(path, out)
    sys.stdout.write(
        f"{out}: {saved.duration_s:.3f} s, {saved.measurements} measurements, "
        f"{saved.messages} messages; lost: {saved.lost}\n"
    )
    if saved.chunk_s is not None:
        sys.stdout.write(
            f"its writer wrote every {saved.chunk_s:.3f} s: about so much more was in its memory\n"
        )
