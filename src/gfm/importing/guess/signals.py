"""Which columns of a table are which signals of which joints.

Shape letters: T rows.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gfm.core import CommandKind, ConfigError
from gfm.core.checks import Array
from gfm.importing.guess.names import MEASURED, Role, has_word, joint_of, role_of, words
from gfm.importing.guess.robot import Robot
from gfm.importing.mapping import Column
from gfm.importing.tables import Table

_IN_ORDER = "the order is taken to be the model's"


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One signal of one joint.

    Attributes:
        joint: As the model calls it.
        role: What it is.
        column: Where it lies.
        index: Which element of the column's lists.
        why: How the joint was told.
        counted: By its place, not by a name.
        before: Columns that fit, too, and do not say that they were measured.
    """

    joint: str
    role: Role
    column: str
    index: int | None
    why: str
    counted: bool = False
    before: tuple[str, ...] = ()

    def values(self, table: Table) -> Array:
        """Returns its numbers as they are in the file, shape (T,)."""
        return table.numbers(Column(column=self.column, index=self.index))


@dataclass(frozen=True, kw_only=True)
class _Place:
    """A column, or one element of its lists, and the words of its name."""

    column: str
    index: int | None
    words: tuple[str, ...]


def signals_of(table: Table, robot: Robot, *, told: bool = False) -> list[Signal]:
    """Returns the signals of the model's joints in a table.

    Columns that name no joint count where there are as many of a kind as the model has joints.

    Args:
        table: What to look through.
        robot: The model's joints.
        told: All of it was told, whatever the columns' names say.
    """
    found: list[Signal] = []
    nameless: dict[tuple[Role, tuple[str, ...]], list[_Place]] = {}
    for place in _places(table):
        joint, rest = joint_of(place.words, robot.joints)
        role = role_of(rest, told=told)
        if role is None:
            continue
        if joint is None:
            family = tuple(word for word in rest if not word.isdigit())
            nameless.setdefault((role, family), []).append(place)
        else:
            found.append(_signal(joint, role, place, f"as in {place.column}"))
    named = {one.role for one in found}
    for (role, _), group in nameless.items():
        if len(group) == len(robot.joints) and role not in named:
            found += _in_order(role, group, robot)
    return found


def _places(table: Table) -> Iterator[_Place]:
    filled = {name: cells for name, cells in table.columns.items() if cells}
    for name, cells in filled.items():
        size = _list_size(cells[0])
        if size is None:
            yield _Place(column=name, index=None, words=words(name))
        for i in range(size or 0):
            yield _Place(column=name, index=i, words=(*words(name), str(i)))


def _list_size(cell: object) -> int | None:
    """Returns how many elements a cell has; None where it is one number or text."""
    if isinstance(cell, str) and cell.lstrip().startswith("["):
        try:
            cell = json.loads(cell)
        except ValueError:
            return None
    return len(cell) if isinstance(cell, list) else None


def _signal(joint: str, role: Role, place: _Place, why: str) -> Signal:
    return Signal(joint=joint, role=role, column=place.column, index=place.index, why=why)


def _in_order(role: Role, group: Sequence[_Place], robot: Robot) -> list[Signal]:
    if len(group) == 1:
        return [replace(_signal(robot.joints[0], role, group[0], "the only joint"), counted=True)]
    return [
        replace(
            _signal(joint, role, place, f"number {i} of {len(group)}; {_IN_ORDER}"), counted=True
        )
        for i, (joint, place) in enumerate(zip(robot.joints, group, strict=True), start=1)
    ]


def chosen(
    signals: Sequence[Signal],
    what: str,
    use: Sequence[str],
    **role: object,
) -> dict[str, Signal]:
    """Returns the one signal of a role for each joint that has it.

    Where several fit and `use` names none, one whose name says that it was measured counts.

    Args:
        signals: All of them.
        what: The role in a word, for messages.
        use: Beginnings of the names of columns to take where several fit, or words in them.
        **role: Fields that the role must have.

    Raises:
        ConfigError: several columns fit.
    """
    found: dict[str, list[Signal]] = {}
    for one in signals:
        if all(getattr(one.role, name) == value for name, value in role.items()):
            found.setdefault(one.joint, []).append(one)
    for joint, several in found.items():
        preferred = [one for one in several if one.column.startswith(tuple(use))]
        preferred = preferred or [one for one in several if has_word(one.column, use)]
        best = preferred or _measured(several)
        if len(best) > 1:
            listed = ", ".join(one.column for one in several)
            raise ConfigError(
                f"{what} of {joint}: {listed} fit; expected one (--use COLUMN says which; the "
                "beginning of its name, or a word in it, is enough)"
            )
        found[joint] = best
    return {joint: several[0] for joint, several in found.items()}


def _measured(several: list[Signal]) -> list[Signal]:
    """Returns the one signal that says it was measured, where no other does; or all of them."""
    said = [one for one in several if MEASURED & set(words(one.column))]
    if len(said) != 1 or len(several) == 1:
        return several
    return [replace(said[0], before=tuple(one.column for one in several if one is not said[0]))]


def chosen_commands(
    signals: Sequence[Signal], robot: Robot, use: Sequence[str]
) -> tuple[dict[str, Signal], CommandKind, str]:
    """Returns the commands of each joint, their kind, and how it was told.

    Commands of the kind that the model takes come first; a name without a kind may be of that.

    Raises:
        ConfigError: several columns fit, or joints are told different kinds.
    """
    told = [one for one in signals if one.role.told]
    pool = [one for one in told if one.role.kind in (robot.command_kind, None)] or told
    commands = chosen(pool, "command", use, told=True)
    kinds = {one.role.kind for one in commands.values()}
    if len(kinds) > 1:
        listed = ", ".join(one.column for one in commands.values())
        raise ConfigError(f"commands {listed}; expected one kind (--use COLUMN says which)")
    kind = next(iter(kinds), None)
    if kind is None:
        return commands, robot.command_kind, "what the model's actuators take"
    return commands, kind, "what the columns' names say"
