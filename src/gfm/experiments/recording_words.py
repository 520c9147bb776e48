"""What is in a recording, in lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gfm.recording.overview import Overview, TopicOverview
from gfm.recording.punctuality import MEANINGS, Delays


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
        yield f"  bridge, {MEANINGS[name]}: {_delays(delays)}"
    for record, entries in seen.metadata.items():
        for key, value in entries.items():
            yield f"  {record}: {key} = {value}"
    for name, size in seen.attachments.items():
        yield f"  attached: {name} ({size} bytes)"


def delay_counts(punctual: Mapping[str, Delays]) -> dict[str, dict[str, int]]:
    """Returns how many delays of each kind, in words, were how long."""
    return {
        f"{MEANINGS[name]}: {_quantiles(delays)}": {
            _until(end): count for end, count in delays.bins.items()
        }
        for name, delays in punctual.items()
    }


def _delays(delays: Delays) -> str:
    bins = (f"{_until(end)} {count}" for end, count in delays.bins.items() if count)
    return f"{_quantiles(delays)}; {', '.join(bins)}"


def _quantiles(delays: Delays) -> str:
    return (
        f"{delays.median_ms:.2f} ms (median), {delays.p99_ms:.2f} ms (99 %), "
        f"{delays.most_ms:.2f} ms (most)"
    )


def _until(end: str) -> str:
    return "over 50 ms" if end == "over" else f"to {end} ms"


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
