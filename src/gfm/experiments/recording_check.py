"""Whether a recording can be used, and what is doubtful about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gfm.core import BadInputError, RecordingError, Trajectory
from gfm.recording import read_recording
from gfm.recording.overview import Overview, overview
from gfm.signals import channels, echoes
from gfm.signals.finding import Finding

PART = ".mcap.part"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What was found out about one recording, each in words.

    Attributes:
        path: The file.
        unfit: Why it cannot be used.
        doubtful: What puts results in doubt.
        notes: Good to know.
    """

    path: Path
    unfit: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """In one word."""
        return "unfit" if self.unfit else "doubtful" if self.doubtful else "fit"


def files_of(paths: Sequence[Path]) -> list[Path]:
    """Returns files, and the recordings in folders; parts that a crash left are among them.

    Raises:
        BadInputError: a folder has none.
    """
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted([*path.glob("*.mcap"), *path.glob(f"*{PART}")])
        if not inside:
            raise BadInputError(f"{path}: has no recording; expected *.mcap or *{PART}")
        found += inside
    return found


def judged(path: Path, *, joint_states: str, command: str) -> Judgement:
    """Returns whether a recording can be used.

    Raises:
        RecordingError: no such file, or not MCAP.
    """
    seen = overview(path, joint_states=joint_states, command=command)
    broken = tuple(_broken(seen, (joint_states, command)))
    if broken:
        return Judgement(path=path, unfit=broken)
    try:
        recording = read_recording(path, joint_states=joint_states, command=command)
    except RecordingError as refusal:
        return Judgement(path=path, unfit=(str(refusal).removeprefix(f"{path}: "),))
    copies = tuple(finding.words for finding in echoes.echoed(recording))
    found = _findings(recording)
    return Judgement(
        path=path,
        unfit=copies,
        doubtful=tuple(one.words for one in found if one.doubtful),
        notes=tuple(one.words for one in found if not one.doubtful),
    )


def _broken(seen: Overview, topics: Sequence[str]) -> Iterator[str]:
    """Yields what is wrong with the file itself."""
    if not seen.complete:
        whose = ", it is being recorded or a crash left it" if seen.path.endswith(PART) else ""
        yield f"{seen.damage}{whose} (`gfm recording salvage` saves what is readable)"
    for one in seen.topics:
        if one.topic in topics and one.rhythm is not None and one.rhythm.backwards:
            yield (
                f"topic {one.topic}: {one.rhythm.backwards} messages are not stamped later than "
                "the one before: out of order, or a clock was set back"
            )


def _findings(recording: Trajectory) -> list[Finding]:
    return [
        *channels.jitter(recording),
        *channels.gaps(recording),
        *channels.repeated(recording),
        *channels.one_stamp_a_cycle(recording),
        *channels.still(recording),
        *channels.odd_velocities(recording),
        *channels.rounded(recording),
    ]
