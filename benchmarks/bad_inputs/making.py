"""What cases of bad input are made of: each makes its files in the current folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.recording import write_recording

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody><body>
    <joint name="a" axis="0 1 0" range="-2 2" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
    <body pos="0 0 -0.3">
      <joint name="b" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/>
    </body>
  </body></worldbody>
  <actuator>
    <position name="a" joint="a" kp="20" kv="1"/>
    <position name="b" joint="b" kp="20" kv="1"/>
  </actuator>
</mujoco>
"""
#: The same with an object that moves freely.
WITH_OBJECT = MODEL.replace(
    "</worldbody>",
    '<body name="brick"><freejoint/><geom size="0.02" mass="0.1"/></body></worldbody>',
)
EPOCH_NS = 1_700_000_000_000_000_000
TICKS = np.arange(300)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One command line that must be refused, or that goes on and says why that is doubtful.

    Attributes:
        command: The program and what it is asked: "gfm diagnose".
        wrong: What is wrong, in words.
        words: Makes the files in the folder that is the current one; returns the rest of the
            command line.
        status: With which the command ends.
        small_disk: Whether the folder must be on a disk of 128 KiB.
    """

    command: str
    wrong: str
    words: Callable[[], list[str]]
    status: int = 2
    small_disk: bool = False


def recording(name: str, seed: int = 0, **changes: object) -> Trajectory:
    """Returns 3 s in which two joints follow sums of sines."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.0, (2, 3))
    waves = [np.sin(w * 0.01 * TICKS[:, None] + phase[:, i]) for i, w in enumerate((2, 5, 11))]
    command = 0.2 * np.sum(waves, axis=0)
    stamp_ns = EPOCH_NS + seed * 10**10 + TICKS * 10_000_000
    one = Trajectory(
        name=name,
        joint_names=("a", "b"),
        stamp_ns=stamp_ns,
        position=np.roll(command, 3, axis=0) + 1e-4 * rng.standard_normal((300, 2)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command,
    )
    return replace(one, **changes)


def written(name: str, seed: int = 0, **changes: object) -> str:
    """Writes a recording; returns its file's name."""
    write_recording(Path(f"{name}.mcap"), recording(name, seed, **changes))
    return f"{name}.mcap"


def text(name: str, what: str | bytes) -> str:
    """Writes a file; returns its name."""
    Path(name).write_bytes(what if isinstance(what, bytes) else what.encode())
    return name


def model(what: str = MODEL, name: str = "model.xml") -> str:
    """Writes a model; returns its file's name."""
    return text(name, what)


def half(name: str) -> str:
    """Cuts a file in half; returns its name."""
    path = Path(name)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return name


def diagnose(*recordings: str, given: str = "", **flags: str) -> list[str]:
    """Returns the words of a diagnosis into `out`."""
    more = [word for flag, value in flags.items() for word in (f"--{flag}", value)]
    return [*recordings, "--model", given or model(), "--minutes", "0.05", "--out", "out", *more]


def folder(name: str) -> str:
    """Makes a folder; returns its name."""
    Path(name).mkdir()
    return name


def renamed(what: str, **names: str) -> str:
    """Returns a model with other names."""
    for old, new in names.items():
        what = what.replace(f'"{old}"', f'"{new}"')
    return what


def cases(command: str, *rows: tuple[str, Callable[[], list[str]]]) -> tuple[Case, ...]:
    """Returns cases of one command that end with status 2."""
    return tuple(Case(command=command, wrong=wrong, words=words) for wrong, words in rows)
