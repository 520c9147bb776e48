"""Which files make a recording together, and the tables that they hold."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gfm.core import RecordingError
from gfm.importing.lerobot import episodes
from gfm.importing.mapping import Files, Mapping
from gfm.importing.ros_bag import bag_tables
from gfm.importing.tables import Table, read_table


@dataclass(frozen=True, kw_only=True)
class Source:
    """The tables of one recording, which are one and the same where one holds both.

    Attributes:
        stem: What names the recording.
        states: With the measurements.
        commands: With the commands.
    """

    stem: str
    states: Table
    commands: Table


def sources(paths: Sequence[Path], mapping: Mapping) -> Iterator[Source]:
    """Yields what files hold, one recording after the other.

    Raises:
        RecordingError: a file that cannot be read, or does not fit the mapping.
        ConfigError: the format needs a package that is not installed.
    """
    if mapping.topics is not None:
        for path in paths:
            states, commands = bag_tables(path, mapping.topics, mapping.columns)
            yield Source(stem=path.stem, states=states, commands=commands)
    elif mapping.format == "lerobot":
        for path in paths:
            for stem, table in episodes(path):
                yield Source(stem=stem, states=table, commands=table)
    elif mapping.files is not None:
        yield from _pairs(paths, mapping, mapping.files)
    else:
        for path in paths:
            table = read_table(path, mapping.format, mapping.rows)
            yield Source(stem=_plain(path).stem, states=table, commands=table)


def _pairs(paths: Sequence[Path], mapping: Mapping, files: Files) -> Iterator[Source]:
    """Yields the recordings of which measurements and commands lie in two files."""
    states, commands = _matching(paths, files.states), _matching(paths, files.commands)
    known = {*states.values(), *commands.values()}
    for path in paths:
        if path not in known:
            raise RecordingError(str(path), "fits neither", f"{files.states} or {files.commands}")
    for stem in sorted(states.keys() ^ commands.keys()):
        have, lacks = (states, files.commands) if stem in states else (commands, files.states)
        raise RecordingError(str(have[stem]), "stands alone", f"{lacks.replace('*', stem)} as well")
    for stem in sorted(states):
        both = (read_table(one[stem], mapping.format, mapping.rows) for one in (states, commands))
        measured, told = both
        yield Source(stem=stem, states=measured, commands=told)


def _plain(path: Path) -> Path:
    return path.with_suffix("") if path.suffix == ".gz" else path


def _matching(paths: Sequence[Path], pattern: str) -> dict[str, Path]:
    """Returns the paths whose name fits a pattern, by what its `*` stands for."""
    expression = re.escape(pattern).replace(r"\*", "(.*)", 1)
    matches = [(re.fullmatch(expression, _plain(path).name), path) for path in paths]
    return {match[1]: path for match, path in matches if match}
