"""A part of a recording as a recording of its own: every topic, byte by byte."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.records import Message
from numpy.typing import NDArray

from gfm.core import ConfigError, RecordingError
from gfm.core.checks import Array
from gfm.recording import schemas
from gfm.recording.new_file import new_file
from gfm.recording.raw import RawRecording, read_raw, write_raw

#: Key of the metadata that says what a part was cut from.
CUT_FROM = "cut_from"
#: Said once, for the whole recording.
_LASTING = (schemas.FIXED_FRAMES, schemas.DESCRIPTION)


def cut(
    path: Path,
    out: Path,
    *,
    begin_s: float = -math.inf,
    end_s: float = math.inf,
    joint_states: str = schemas.JOINT_STATES,
    command: str = schemas.COMMAND,
) -> RawRecording:
    """Writes a part of a recording to a new file; returns what it holds.

    Commands hold until the next: the one in force at the beginning of the part is in it.

    Args:
        path: The recording.
        out: The file to make.
        begin_s: From when, in seconds since the first measurement.
        end_s: Until when, itself not included.
        joint_states: Topic of the measurements.
        command: Topic of the applied commands.

    Raises:
        ConfigError: the end is not later than the beginning.
        RecordingError: the recording is no whole MCAP file, or has no measurement then.
        BadInputError: `out` exists, or cannot be written.
    """
    if not begin_s < end_s:
        raise ConfigError(f"from {begin_s:g} s to {end_s:g} s; expected an end after the beginning")
    whole = _whole(path, joint_states)
    messages = whole.by_topic()
    held = (command, f"{command}_requested", schemas.REASON)
    kept, lasting = list[Message](), list[Message]()
    for topic, listed in messages.items():
        if topic in _LASTING:
            lasting += listed
            continue
        times_s = whole.since_first(topic, joint_states)
        if topic == joint_states:
            _check_part(f"{path}: topic {topic}", times_s, begin_s, end_s)
        places = _inside(times_s, begin_s, end_s, held=topic in held)
        kept += [listed[i] for i in places.tolist()]
    part = replace(whole, messages=_in_order(kept, lasting))
    with new_file(out) as place:
        write_raw(place, part, _about(whole, path, begin_s, end_s))
    return part


def _whole(path: Path, joint_states: str) -> RawRecording:
    """Returns a recording that lacks nothing to be cut."""
    raw = read_raw(path)
    if not raw.complete:
        expected = "a whole one (`gfm recording salvage` makes one of what is readable)"
        raise RecordingError(str(path), "cut off or damaged", expected)
    messages = raw.by_topic()
    if not messages.get(joint_states):
        expected = f"measurements; topics in the file: {', '.join(messages) or 'none'}"
        raise RecordingError(f"{path}: topic {joint_states}", "has no messages", expected)
    return raw


def _inside(times_s: Array, begin_s: float, end_s: float, *, held: bool) -> NDArray[np.intp]:
    """Returns the places of what belongs to a part; what is `held` does until the next comes."""
    inside = (times_s >= begin_s) & (times_s < end_s)
    before = np.flatnonzero(times_s < begin_s)
    if held and len(before):
        inside[before[-1]] = True
    return np.flatnonzero(inside)


def _check_part(where: str, times_s: Array, begin_s: float, end_s: float) -> None:
    if not len(_inside(times_s, begin_s, end_s, held=False)):
        problem = f"has nothing from {begin_s:g} s to {end_s:g} s"
        raise RecordingError(where, problem, f"a part of 0 s to {times_s[-1]:.3f} s")


def _in_order(kept: Sequence[Message], lasting: Sequence[Message]) -> list[Message]:
    """Returns messages as they were logged; what lasts is logged when the part begins.

    Otherwise a viewer's time would begin with it, long before.
    """
    first_ns = min(message.log_time for message in kept)
    late = [replace(m, log_time=max(m.log_time, first_ns)) for m in lasting]
    return sorted([*late, *kept], key=lambda message: message.log_time)


def _about(
    whole: RawRecording, path: Path, begin_s: float, end_s: float
) -> dict[str, dict[str, str]]:
    """Returns the metadata of the whole, with where the part comes from."""
    about = whole.entries()
    ours = about.setdefault(schemas.ABOUT_RECORD, {})
    since = "the beginning" if math.isinf(begin_s) else f"{begin_s:g} s"
    until = "the end" if math.isinf(end_s) else f"{end_s:g} s"
    before = f"{ours[CUT_FROM]}; of that " if CUT_FROM in ours else ""
    ours[CUT_FROM] = f"{before}{path.name} from {since} to {until}"
    return about
