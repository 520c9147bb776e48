"""The lines of a mapping that say which columns are a joint's, in which unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gfm.core import CommandKind
from gfm.importing.guess.found import Found
from gfm.importing.guess.lines import Line, column_text, quoted
from gfm.importing.guess.robot import Asked, Robot
from gfm.importing.guess.signals import Signal
from gfm.importing.guess.units import (
    Told,
    Unit,
    check_same_unit,
    named_unit,
    to_rad,
    told_unit,
    unit_of,
)


def joint_lines(
    found: Found,
    robot: Robot,
    asked: Asked,
    joints: Sequence[tuple[Signal, Signal]],
    kind: CommandKind,
    optional: Mapping[CommandKind, Sequence[Signal]],
) -> list[Line]:
    """Returns the tables of all joints."""
    common = _unit(found, robot, asked, joints, kind)
    lines = []
    for number, (position, command) in enumerate(joints):
        name = position.joint
        unit = _own(position, common, asked)
        lines += [
            Line(text="\n[[joints]]"),
            Line(text=f"name = {quoted(name)}", why=position.why),
            _line("position", position, CommandKind.POSITION, unit, robot, found),
        ]
        for other, signals in optional.items():
            measured = signals[number]
            own = _own(measured, unit, asked)
            lines.append(_line(str(other), measured, other, own, robot, found))
        lines.append(_line("command", command, kind, _own(command, unit, asked), robot, found))
    return lines


def _own(signal: Signal, otherwise: Told, asked: Asked) -> Told:
    """Returns the unit that a signal's name says, where the user said none for all."""
    return otherwise if asked.unit else unit_of(signal.column, otherwise)


def _line(
    key: str, signal: Signal, kind: CommandKind, unit: Told, robot: Robot, found: Found
) -> Line:
    percent = found.lerobot and _is_gripper(signal) and unit.unit is not Unit.RAD
    scale, offset = to_rad(unit.unit, signal.joint, robot, percent=percent)
    if kind is CommandKind.EFFORT:
        scale, offset, why = 1.0, 0.0, "taken as N m"
    elif percent:
        why = "0 to 100 over the model's range, as LeRobot counts grippers"
    else:
        why = unit.why
    if kind is CommandKind.VELOCITY:
        named = (
            "the name says"
            if named_unit(signal.column) is unit.unit
            else f"positions are {unit.unit}"
        )
        offset, why = 0.0, f"{unit.unit} per second, as {named}"
    if key == "command" and signal.counted:
        why = f"{signal.why}; {why}"
    if signal.before:
        why = f"{why}; rather than {', '.join(signal.before)}, it says measured"
    text = f"{key} = {column_text(signal.column, signal.index, scale, offset)}"
    return Line(text=text, why=why)


def _is_gripper(signal: Signal) -> bool:
    return "gripper" in signal.column.lower() or "gripper" in signal.joint.lower()


def _unit(
    found: Found,
    robot: Robot,
    asked: Asked,
    joints: Sequence[tuple[Signal, Signal]],
    kind: CommandKind,
) -> Told:
    """Returns the unit of positions whose names say none; commands have that of their joint."""
    values = {}
    for position, command in joints:
        if found.lerobot and _is_gripper(position):
            continue
        values[position.joint] = position.values(found.states)
        if kind is CommandKind.POSITION and not _differ_by_name(position, command):
            told = command.values(found.commands)
            if found.states is found.commands:
                check_same_unit(position.joint, values[position.joint], told)
            values[position.joint] = np.concatenate([values[position.joint], told])
    if asked.unit is not None:
        return Told(unit=Unit(asked.unit), why=f"{asked.unit}, as said")
    named = {position.joint: named_unit(position.column) for position, _ in joints}
    said = {unit for unit in named.values() if unit is not None}
    if len(said) == 1:
        return Told(unit=said.pop(), why="as the other joints' names say")
    nameless = {joint: x for joint, x in values.items() if named[joint] is None}
    return told_unit(nameless, robot, lerobot=found.lerobot)


def _differ_by_name(position: Signal, command: Signal) -> bool:
    """Returns whether a joint's columns are named with two units."""
    return {named_unit(position.column), named_unit(command.column)} == {Unit.RAD, Unit.DEGREES}
