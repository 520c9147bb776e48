"""Kills a process that records, at random moments, and looks at what it leaves.

    python benchmarks/recording_kills.py --kills 1000 --seed 0 --out results.md
    python benchmarks/recording_kills.py --kills 10000 --parts build/kills  # goes on, or shares

The process is the bridge's recorder with its thread, fed with reports of an arm at 100 Hz and
commands at 50 Hz, one short recording after the other, in one folder for a part of 100 kills: five
processes in a row use the same names, so that they meet what the ones before them left. After every
kill:

- every complete recording is read as `gfm diagnose` reads it, and has every report;
- every part is salvaged, and is compared with what had been handed to the recorder before the kill;
- every file from before is still there, by inode, size and time of its last change.

Exit status 1 if any of that fails.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from itertools import count, islice
from pathlib import Path

import numpy as np
from parts import Part, commits, done_parts

from gfm.core import BadInputError, Command, CommandKind, Observation, RefusedError
from gfm.recording import read_recording
from gfm.recording.raw import read_raw
from gfm.recording.salvage import salvage
from gfm.recording.schemas import JOINT_STATES
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.background import InThread
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.content import content_of
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.recorder import Recorder
from gfm_wire import RecordStart

_REPORT_NS = 10_000_000
_SHARED = 5
_ALLOWED_S = 1.0
_KILLS_IN_A_PART = 100
_WORD = struct.Struct("<iq")


# The process that is killed


def record_forever(folder: Path, names: str, rng: np.random.Generator, told: int) -> None:
    """Records motions of 0.1 to 2.5 s, and says on a pipe what the recorder was given.

    Args:
        folder: Of the recordings.
        names: Begins the name of each.
        rng: For their lengths.
        told: The pipe: number of the recording and stamp of the report, after each.
    """
    config = BridgeConfig(name="kills", recordings=str(folder))
    content = content_of(config, MirrorRobot(JOINT_NAMES))
    recorder = Recorder(folder, lambda: config.about, InThread(), content)
    next_s = time.monotonic()
    stamps_ns = count(0, _REPORT_NS)
    for number in range(10_000):
        if not _begun(recorder, f"{names}_{number}"):
            continue
        for stamp_ns in islice(stamps_ns, int(rng.integers(10, 250))):
            _feed(recorder, stamp_ns)
            os.write(told, _WORD.pack(number, stamp_ns))
            next_s += _REPORT_NS * 1e-9
            time.sleep(max(0.0, next_s - time.monotonic()))
        answer = recorder.stop()
        while answer() is None:
            time.sleep(1e-4)


def _begun(recorder: Recorder, name: str) -> bool:
    """Returns whether a recording of that name could begin: one that is whole is in the way."""
    try:
        answer = recorder.start(RecordStart(name=name))
    except RefusedError:
        return False
    while answer() is None:
        time.sleep(1e-4)
    return True


def _feed(recorder: Recorder, stamp_ns: int) -> None:
    """Gives the recorder a report, and in every second period a command before it."""
    values = np.sin(1e-9 * stamp_ns + np.arange(7.0))
    if stamp_ns % (2 * _REPORT_NS) == 0:
        command = Command(
            kind=CommandKind.POSITION, joint_names=JOINT_NAMES, values=values, stamp_ns=stamp_ns
        )
        recorder.command(command, command, 0)
    report = Observation(
        joint_names=JOINT_NAMES,
        position=values,
        velocity=np.cos(values),
        effort=values,
        stamp_ns=stamp_ns,
    )
    recorder.report(report)
    recorder.period(report)


# What it leaves


@dataclass(kw_only=True)
class Tally:
    """What was found so far.

    Attributes:
        kills: Processes killed.
        whole: Complete recordings.
        parts: Parts with measurements.
        young: Parts that had none yet.
        lost_s: Of each part, from its last readable report to the last that was handed over.
        problems: What must not be.
    """

    kills: int = 0
    whole: int = 0
    parts: int = 0
    young: int = 0
    lost_s: list[float] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A file as it was left."""

    name: str
    size: int
    changed_ns: int


Handed = dict[int, list[int]]


def killed_after(folder: Path, names: str, seed: int, seconds: float) -> Handed:
    """Kills a recording process; returns the stamps handed over, ns, by recording."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        try:
            record_forever(folder, names, np.random.default_rng(seed), write)
        finally:
            os._exit(1)
    os.close(write)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    with os.fdopen(read, "rb") as pipe:
        content = pipe.read()
    if not os.WIFSIGNALED(status):
        raise RuntimeError(f"the recording process ended by itself: {status}")
    handed: Handed = {}
    for number, stamp_ns in _WORD.iter_unpack(content[: len(content) // _WORD.size * _WORD.size]):
        handed.setdefault(number, []).append(stamp_ns)
    return handed


def look(folder: Path, names: str, handed: Handed, known: dict[int, Seen], tally: Tally) -> None:
    """Judges what a killed process left, and whether what was there before still is."""
    # Of two names for one file, which a kill may leave, the whole recording's comes last.
    now = {path.stat().st_ino: path for path in sorted(folder.iterdir(), reverse=True)}
    tally.problems += _missing(now, known)
    for inode, path in now.items():
        if inode not in known:
            number = int(path.name.removeprefix(f"{names}_").partition(".")[0])
            judge = _judge_part if path.suffix == ".part" else _judge_whole
            judge(path, handed.get(number, []), tally)
            known[inode] = _seen(path)


def _seen(path: Path) -> Seen:
    stat = path.stat()
    return Seen(name=path.name, size=stat.st_size, changed_ns=stat.st_mtime_ns)


def _missing(now: dict[int, Path], known: dict[int, Seen]) -> Iterator[str]:
    """Yields what is no longer as it was; a part may have been renamed, a recording not."""
    for inode, before in known.items():
        path = now.get(inode)
        if path is None:
            yield f"{before.name} is gone"
            continue
        seen = _seen(path)
        same = (seen.size, seen.changed_ns) == (before.size, before.changed_ns)
        aside = before.name.endswith(".part") and "_crashed_" in seen.name
        if not same or (seen.name != before.name and not aside):
            yield f"{before.name} was changed: {seen}"


def _judge_whole(path: Path, handed: list[int], tally: Tally) -> None:
    tally.whole += 1
    try:
        recording = read_recording(path)
    except BadInputError as error:
        tally.problems.append(str(error))
        return
    if recording.stamp_ns.tolist() != handed:
        found, expected = len(recording.stamp_ns), len(handed)
        tally.problems.append(f"{path}: {found} reports, expected the {expected} handed over")


def _judge_part(path: Path, handed: list[int], tally: Tally) -> None:
    """Salvages a part beside the folder, and compares it with what was handed over."""
    stamps: list[int] = []
    with tempfile.TemporaryDirectory() as aside:
        out = Path(aside) / "saved.mcap"
        try:
            salvage(path, out)
        except BadInputError:
            tally.young += 1
        else:
            raw = read_raw(out)
            stamps = raw.stamps_ns(JOINT_STATES, raw.by_topic()[JOINT_STATES]).tolist()
            tally.parts += 1
    # The last one may be on the disk before the pipe was told.
    if stamps[: len(handed)] != handed[: len(stamps)]:
        tally.problems.append(f"{path}: reports are missing before the last one")
    lost_s = max(0, len(handed) - len(stamps)) * _REPORT_NS * 1e-9
    if lost_s > _ALLOWED_S:
        tally.problems.append(f"{path}: the last {lost_s:.2f} s are lost")
    tally.lost_s.append(lost_s)


def killed_part(rng: np.random.Generator, kills: int, longest_s: float) -> Part:
    """Kills as often as told, after `longest_s` at most each, in a folder of its own."""
    tally, known = Tally(), dict[int, Seen]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for kill in range(kills):
            names = f"run_{kill // _SHARED}"
            seconds = float(rng.uniform(0.0, longest_s))
            handed = killed_after(folder, names, int(rng.integers(2**31)), seconds)
            tally.kills += 1
            look(folder, names, handed, known, tally)
    return asdict(tally)


def together(parts: Iterable[Part]) -> Tally:
    """Returns the sum of tallies."""
    tally = Tally()
    for part in parts:
        one = Tally(**{name: part[name] for name in asdict(tally)})
        for name, value in vars(one).items():
            setattr(tally, name, getattr(tally, name) + value)
    return tally


def report(tally: Tally, seed: int, ran_on: str) -> str:
    """Returns the result as Markdown."""
    lost = np.array(tally.lost_s) if tally.lost_s else np.zeros(1)
    lines = [
        f"{tally.kills} kills, seed {seed}, commit {ran_on}:",
        "",
        "| | |",
        "|---|---|",
        f"| complete recordings, all readable with every report | {tally.whole} |",
        f"| parts left by a kill, readable | {tally.parts} |",
        f"| parts that had no measurement yet | {tally.young} |",
        f"| kills while there was no part | {tally.kills - tally.parts - tally.young} |",
        f"| lost of a part: median | {np.median(lost):.3f} s |",
        f"| lost of a part: 99 % at most | {np.percentile(lost, 99):.3f} s |",
        f"| lost of a part: most | {lost.max():.3f} s |",
        f"| unreadable, incomplete, overwritten, or more than 1 s lost | {len(tally.problems)} |",
    ]
    return "\n".join([*lines, *(f"\n{problem}" for problem in tally.problems)]) + "\n"


def main() -> int:
    """Runs it; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--longest-s", type=float, default=2.5, help="until a kill")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--parts", type=Path, help="where parts are kept (default: nowhere)")
    parser.add_argument(
        "--no-work", action="store_true", help="only report the parts that are done"
    )
    parser.add_argument("--out", type=Path, help="Markdown")
    arguments = parser.parse_args()
    logging.disable()
    longest_s, names = arguments.longest_s, {}
    for first in range(0, arguments.kills, _KILLS_IN_A_PART):
        kills = min(_KILLS_IN_A_PART, arguments.kills - first)
        names[f"seed_{arguments.seed}_{longest_s:g}_s_kills_{first}_to_{first + kills}"] = first

    def work(name: str) -> Part:
        rng = np.random.default_rng([arguments.seed, names[name]])
        kills = min(_KILLS_IN_A_PART, arguments.kills - names[name])
        return killed_part(rng, kills, longest_s)

    with tempfile.TemporaryDirectory() as place:
        folder, do = arguments.parts or Path(place), None if arguments.no_work else work
        parts = done_parts(folder, list(names), do)
    tally = together(parts.values())
    text = report(tally, arguments.seed, commits(parts))
    sys.stdout.write(text)
    if arguments.out is not None:
        arguments.out.write_text(text)
    return 1 if tally.problems else 0


if __name__ == "__main__":
    sys.exit(main())
