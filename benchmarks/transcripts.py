"""Goes four ways of a new user from files to a verdict, and writes down what the commands say.

    python benchmarks/transcripts.py --data ../shared/data  # all
    python benchmarks/transcripts.py --data ../shared/data --only csv

The files are those that people have: `foreign` makes them of recordings at hand, in a folder of
their own. Every command is run by a shell, as it stands on the page.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # bags are written there

from foreign import Sources, lerobot_dataset, ros2_bags, table_and_urdf  # noqa: E402

PAGE = ROOT / "docs" / "first_diagnosis.md"
#: Of a longer answer the page keeps these lines from its beginning and its end.
_FIRST, _LAST = 40, 10


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way from files to a verdict.

    Attributes:
        name: A word.
        title: Of its part of the page.
        words: What the files are, and where they come from.
        make: Writes them into a folder.
        recordings: How many of the recordings at hand are taken.
        commands: What the user types.
    """

    name: str
    title: str
    words: str
    make: Callable[[Path, Sources], None]
    recordings: int
    commands: tuple[str, ...]


WAYS = (
    Way(
        name="csv",
        title="Tables and a URDF",
        words="""\
A two-joint arm with torque-controlled drives: two measured runs of the DFKI double pendulum
(design C.1), its builders' own tables, and a URDF with their masses and inertias. The tables have
measured and filtered columns side by side and number the joints. The URDF has no actuators:
`--actuators torque` adds them.""",
        make=table_and_urdf.make,
        recordings=2,
        commands=(
            "gfm import run*.csv --model arm.urdf --actuators torque --yes --out recordings",
            "gfm diagnose recordings/*.mcap --model arm.urdf --actuators torque --minutes 4 "
            "--out diagnosis",
        ),
    ),
    Way(
        name="ros2",
        title="A ROS 2 bag",
        words="""\
An arm of seven joints with velocity control, one bag for each motion: `sensor_msgs/JointState` with
a gripper in it, in another order than the model's, and the controller's commands as bare
`std_msgs/Float64MultiArray`. **These recordings are simulated**, by another simulator than this
project's; only the bags are as a robot's recorder leaves them. What is hidden: a rotor of right_j2
that has 0.35 kg m² more than the model.""",
        make=ros2_bags.make,
        recordings=3,
        commands=(
            "gfm import motion* --model arm.xml --yes --out recordings",
            "gfm diagnose recordings/*.mcap --model arm.xml --minutes 1 --out diagnosis",
        ),
    ),
    Way(
        name="lerobot",
        title="A LeRobot dataset",
        words="""\
An SO-101: two measured motions of a real arm (github.com/isaac-sim2real/sage), as a dataset of
version 3 in degrees, and the model with the figures of MuJoCo Menagerie. A dataset does not say its
unit; `--unit degrees` does where sizes leave it open. [An SO-101 at home](so101.md) has more about
this arm.""",
        make=lerobot_dataset.make,
        recordings=2,
        commands=(
            "gfm import so101_motions --model so101.xml --unit degrees --yes --out recordings",
            "gfm diagnose recordings/*.mcap --model so101.xml --minutes 4 --out diagnosis",
        ),
    ),
    Way(
        name="lerobot_v2",
        title="A LeRobot dataset of version 2",
        words="""\
The same arm in two other measured motions, as a dataset of version 2.1: a file for each episode,
and the names that older recorders gave the motors (`main_shoulder_pan`). Nothing has to be
converted first.""",
        make=lerobot_dataset.make_v2,
        recordings=2,
        commands=(
            "gfm import so101_paths --model so101.xml --unit degrees --yes --out recordings",
            "gfm diagnose recordings/*.mcap --model so101.xml --minutes 4 --out diagnosis",
        ),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Said:
    """What came of a command.

    Attributes:
        command: As it was typed.
        text: What it said, on both streams.
        status: With which it ended.
        took_s: How long it took.
    """

    command: str
    text: str
    status: int
    took_s: float


def typed(command: str, folder: Path) -> Said:
    """Runs a command line in a folder, in a shell that finds this environment's `gfm`."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    began = time.monotonic()
    ended = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env={**os.environ, "PATH": path, "COLUMNS": "100"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    took_s = time.monotonic() - began
    return Said(command=command, text=ended.stdout, status=ended.returncode, took_s=took_s)


def gone(way: Way, folder: Path, sources: Sources) -> list[Said]:
    """Makes a way's files in a folder and goes the way, as far as commands end well."""
    way.make(folder, sources)
    said = [typed("ls", folder)]
    for command in way.commands:
        said.append(typed(command, folder))
        if said[-1].status:
            break
    return said


def section(way: Way, said: Sequence[Said]) -> str:
    """Returns a way's part of the page."""
    blocks = "\n".join(_block(one) for one in said)
    took = ", ".join(f"{one.took_s:.0f} s" for one in said[1:])
    date = time.strftime("%Y-%m-%d")
    return f"\n## {way.title}\n\n{way.words}\n\n{blocks}\nThe commands took {took} ({date}).\n"


def with_section(page: str, way: Way, part: str) -> str:
    """Returns the page with a new part of a way in the place of the old one."""
    title = f"## {way.title}\n"
    before, found, rest = page.partition(f"\n{title}")
    if not found:
        raise SystemExit(f"{PAGE.name}: no part {title.strip()!r}; expected one to replace")
    _, next_title, after = rest.partition("\n## ")
    return before + part + next_title + after


def _block(said: Said) -> str:
    lines = [line.rstrip() for line in said.text.strip().splitlines()]
    if len(lines) > _FIRST + _LAST + 1:
        left_out = len(lines) - _FIRST - _LAST
        lines = [*lines[:_FIRST], f"... {left_out} more lines ...", *lines[-_LAST:]]
    return "\n".join(["```console", f"$ {said.command}", *lines, "```", ""])


def main(argv: Sequence[str] | None = None) -> int:
    """Goes the ways; returns 1 where one ends before its verdict."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    parser.add_argument("--only", choices=[way.name for way in WAYS])
    arguments = parser.parse_args(argv)
    failed = False
    for way in WAYS:
        if arguments.only in (None, way.name):
            with tempfile.TemporaryDirectory() as folder:
                said = gone(way, Path(folder), Sources(data=arguments.data, most=way.recordings))
            failed |= said[-1].status != 0
            print(section(way, said), flush=True)
            if said[-1].status == 0:
                PAGE.write_text(with_section(PAGE.read_text(), way, section(way, said)))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
