"""What is in a recording, in lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from gfm.recording.overview import Overview, TopicOverview
from gfm.recording.punctuality import Delays


def overview_lines(seen: Overview) -> Iterator[str]:
    """Yields them: the file, its topics with their rates, joints, what it says of itself."""
    yield f"{seen.path}: {seen.bytes / 1e6:.2f} MB, {seen.damage or 'whole'}"
    kind = f", {seen.command_kind} commands" if seen.command_kind else ""
    begin = "" if seen.begin_ns is None else f", from {seen.begin_ns * 1e-9:.6f} s of its clock"
    yield f"  {seen.duration_s:.3f} s{begin}{kind}"
    yield f"  profile {seen.profile or 'none'}, written by {seen.writer or 'nobody who says so'}"
    width = max((len(one.topic) for one in seen.topics), default=0)
    kinds = max((len(one.type) for one in seen.topics), default=0)
    for one in seen.topics:
        yield f"  {one.topic:{width}}  {one.type:{kinds}}  {_rhythm(one)}"
    for one in seen.topics:
        if one.joints:
            filled = ", ".join(one.filled) or "nothing"
            yield f"  {one.topic}: {filled} of {', '.join(one.joints)}"
    for name, delays in seen.punctuality.items():
        yield f"  {_PUNCTUAL[name]}: {_delays(delays)}"
    for record, entries in seen.metadata.items():
        for key, value in entries.items():
            yield f"  {record}: {key} = {value}"
    for name, size in seen.attachments.items():
        yield f"  attached: {name} ({size} bytes)"


_PUNCTUAL = {
    "heard_to_sent": "bridge, from a command heard to sent",
    "uneven": "bridge, reports off their median period",
}


def _delays(delays: Delays) -> str:
    bins = ", ".join(
        f"{'over 50' if end == 'over' else f'to {end}'} ms {count}"
        for end, count in delays.bins.items()
        if count
    )
    return (
        f"{delays.median_ms:.2f} ms (median), {delays.p99_ms:.2f} ms (99 %), "
        f"{delays.most_ms:.2f} ms (most); {bins}"
    )


def _rhythm(one: TopicOverview) -> str:
    count = f"{one.messages} messages"
    if one.rhythm is None or one.begin_s is None or one.end_s is None:
        return count
    told = (
        f"{count}, {one.begin_s:.3f} to {one.end_s:.3f} s, {one.rhythm.rate_hz:.2f} Hz "
        f"(median period {1e3 * one.rhythm.period_s:.3f} ms, jitter "
        f"{1e3 * one.rhythm.jitter_s:.3f} ms, longest gap {1e3 * one.rhythm.longest_gap_s:.1f} ms)"
    )
    if one.rhythm.backwards:
        told += f", {one.rhythm.backwards} not later than the one before"
    return told if one.stamped_by == "header" else f"{told}, as logged"
