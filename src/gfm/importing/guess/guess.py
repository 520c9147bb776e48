"""From a file and a model to the text of a mapping."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from gfm.core import CommandKind, RecordingError
from gfm.importing.formats import ALSO_NAMED, TABLE_FORMATS
from gfm.importing.guess.clock import TIMES, bag_time_lines, time_line
from gfm.importing.guess.found import Found
from gfm.importing.guess.joints import joint_lines
from gfm.importing.guess.lines import Line, quoted, toml
from gfm.importing.guess.names import OTHER, words
from gfm.importing.guess.order import in_followed_order
from gfm.importing.guess.robot import Asked, Robot
from gfm.importing.guess.signals import Signal, chosen, chosen_commands, signals_of
from gfm.importing.guess.topics import bag_topics
from gfm.importing.lerobot import TIMESTAMP, episodes
from gfm.importing.tables import Table, read_table

_BAGS = (".bag", ".db3", ".mcap")
#: Of columns that are not read so many are named.
_NAMED = 8


def guessed_mapping(path: Path, robot: Robot, asked: Asked) -> str:
    """Returns the mapping that fits a file to a model, as TOML with a reason for every line.

    Args:
        path: Table, bag or dataset.
        robot: The model's joints.
        asked: What the user said where several things fit.

    Raises:
        RecordingError: the file cannot be read, or lacks what a mapping needs.
        ConfigError: several things fit; the message says which, and how to choose.
    """
    found = _opener(path)(path, robot, asked)
    measured = {"told": False, "kind": CommandKind.POSITION}
    position = chosen(found.signals, "position", asked.use, **measured)
    command, kind, why = chosen_commands(found.signals, robot, asked.use)
    if kind is CommandKind.POSITION:
        command = in_followed_order(position, command, found.states, found.commands)
    joints = [name for name in robot.joints if name in position and name in command]
    if not joints:
        raise _no_joints(path, robot, found, position)
    pairs = [(position[joint], command[joint]) for joint in joints]
    optional = _optional(found, asked, joints)
    lines = [
        Line(text="", why=f"guessed from {path.name}; check it"),
        *found.head,
        Line(text=f"command_kind = {quoted(kind)}", why=why),
        *_left_out(robot, joints),
        *_not_read(found, [*itertools.chain(*pairs), *itertools.chain(*optional.values())]),
        *found.tail,
        *joint_lines(found, robot, asked, pairs, kind, optional),
    ]
    return toml(lines)


def _opener(path: Path) -> Callable[[Path, Robot, Asked], Found]:
    """Returns what reads a file, by its name."""
    if not path.exists():
        raise RecordingError(str(path), "no such file", "a table, a bag or a dataset")
    if (path / "meta").is_dir():
        return _dataset
    if path.is_dir() or path.suffix in _BAGS:
        return _bag
    if _table_format(path) in TABLE_FORMATS:
        return _table
    known = ", ".join(f".{name}" for name in (*TABLE_FORMATS, *ALSO_NAMED))
    expected = f"{known}, {', '.join(_BAGS)}, or the folder of a bag or a LeRobot dataset"
    raise RecordingError(str(path), "its name does not tell the format", expected)


def _table_format(path: Path) -> str:
    plain = path.with_suffix("") if path.suffix == ".gz" else path
    name = plain.suffix.removeprefix(".")
    return ALSO_NAMED.get(name, name)


def _table(path: Path, robot: Robot, _asked: Asked) -> Found:
    file_format = _table_format(path)
    table = read_table(path, file_format)
    head = [Line(text=f"format = {quoted(file_format)}", why="its name"), time_line(table)]
    signals = signals_of(table, robot)
    return Found(head=head, states=table, commands=table, signals=signals)


def _dataset(path: Path, robot: Robot, _asked: Asked) -> Found:
    tables = [table for _, table in episodes(path)]
    first = tables[0]
    joined = {name: [x for one in tables for x in one.columns[name]] for name in first.columns}
    table = Table(path=path, digest=first.digest, columns=joined)
    head = [
        Line(text='format = "lerobot"', why="has meta/info.json"),
        Line(text=f"time = {quoted(TIMESTAMP)}", why="frame number / fps: planned, not measured"),
    ]
    signals = signals_of(table, robot)
    return Found(head=head, states=table, commands=table, signals=signals, lerobot=True)


def _bag(path: Path, robot: Robot, asked: Asked) -> Found:
    states, commands = bag_topics(path, robot, asked.use)
    measured = [one for one in states.signals if not one.role.told]
    told = [one for one in commands.signals if one.role.told]
    head = [
        Line(text='format = "rosbag"', why="a ROS bag"),
        *bag_time_lines(states.table, commands.table),
    ]
    tail = [
        Line(text="\n[topics]"),
        Line(text=f"states = {quoted(states.name)}", why=f"{states.kind} with joints of the model"),
        Line(text=f"commands = {quoted(commands.name)}", why=f"{commands.kind}: what was told"),
    ]
    return Found(
        head=head,
        tail=tail,
        states=states.table,
        commands=commands.table,
        signals=[*measured, *told],
    )


def _no_joints(
    path: Path, robot: Robot, found: Found, position: Mapping[str, Signal]
) -> RecordingError:
    what = "position and command" if position else "position"
    columns = ", ".join(dict.fromkeys([*found.states.columns, *found.commands.columns]))
    joints = f"joints of the model ({', '.join(robot.joints)}), or as many columns as it has"
    expected = f"{joints}, among {columns}"
    return RecordingError(str(path), f"no column is the {what} of a joint", expected)


def _left_out(robot: Robot, joints: Sequence[str]) -> list[Line]:
    absent = [name for name in robot.joints if name not in joints]
    text = f"left out, for the file lacks position or command: {', '.join(absent)}"
    return [Line(text="", why=text)] if absent else []


def _not_read(found: Found, read: Sequence[Signal]) -> list[Line]:
    """Returns which columns are not read that might be signals: of joints that the model lacks."""
    tables = [found.states] if found.states is found.commands else [found.states, found.commands]
    columns = dict.fromkeys(name for table in tables for name in table.columns)
    taken = {name for signal in read for name in (signal.column, *signal.before)}
    no_signal = OTHER | TIMES
    others = [name for name in columns if name not in taken and not no_signal & {*words(name)}]
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    text = f"not read: {', '.join(others[:_NAMED])}{more}"
    return [Line(text="", why=text)] if others else []


def _optional(found: Found, asked: Asked, joints: Sequence[str]) -> dict[CommandKind, list[Signal]]:
    """Returns measured velocities and efforts, each for all joints or not at all."""
    signals = {
        other: chosen(found.signals, str(other), asked.use, told=False, kind=other)
        for other in (CommandKind.VELOCITY, CommandKind.EFFORT)
    }
    return {
        other: [there[joint] for joint in joints]
        for other, there in signals.items()
        if all(joint in there for joint in joints)
    }
