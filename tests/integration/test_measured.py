"""What the diagnosis makes of robots that others recorded, on their fixed splits."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.inference.constants import LEAST_CONFIDENCE
from gfm.diagnosis.output.result import Diagnosis, Verdict

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
Measured = Callable[[str, str], list[Trajectory]]


def split(
    recordings: list[Trajectory], held_out: tuple[str, ...]
) -> tuple[list[Trajectory], list[Trajectory]]:
    held = [r for r in recordings if any(part in r.name for part in held_out)]
    return [r for r in recordings if r not in held], held


def errors_after(
    specs: dict[CommandKind, mujoco.MjSpec], held: list[Trajectory], found: Diagnosis
) -> list[np.ndarray]:
    effects = [one.instance() for one in found.effects]
    return prepared(all_segments(specs, held, windows_s=WHOLE)).position_errors(effects)


def in_minutes(minutes: float) -> Callable[[], float]:
    """Returns what tells the share of the time that is left."""
    begun = time.monotonic()
    return lambda: 1.0 - (time.monotonic() - begun) / (60.0 * minutes)


def test_an_xl330_is_followed_nearer_and_no_stribeck_friction_claimed(measured: Measured) -> None:
    training, held = split(measured("bam_xl330/raw/*.json.gz", "xl330.toml"), ("kp200_",))
    spec = mujoco.MjSpec.from_file(str(ROOT / "models" / "xl330_pendulum.xml"))
    specs = {CommandKind.POSITION: spec}
    # Its laws stand for one another: all of them together are surer than each.
    time_left = in_minutes(10.0)
    found = diagnose(specs, training, held, time_left=time_left, keep_suspects=True)
    sure = {one.effect for one in found.effects if one.confidence >= LEAST_CONFIDENCE}
    assert sure
    assert "stribeck_friction" not in sure
    assert found.verdict is Verdict.PARTLY_EXPLAINED
    errors = np.concatenate(errors_after(specs, held, found))
    assert np.mean(np.abs(errors)) < 0.06  # 0.108 of the model as it is


def test_coulomb_friction_is_found_on_both_joints_of_the_double_pendulum(
    measured: Measured,
) -> None:
    recordings = measured("dfki_double_pendulum/C1_*.csv.gz", "double_pendulum.toml")
    training, held = split(recordings, ("154220", "154548", "tvlqr"))
    spec = mujoco.MjSpec.from_file(str(ROOT / "models" / "double_pendulum_c1.xml"))
    specs = {CommandKind.EFFORT: spec}
    found = diagnose(specs, training, held, time_left=in_minutes(10.0))
    friction = {one.joints for one in found.effects if one.effect == "coulomb_friction"}
    assert friction == {("shoulder",), ("elbow",)}
    rmse = [np.sqrt(np.mean(e**2, axis=0)) for e in errors_after(specs, held, found)]
    shoulder, elbow = np.median(rmse, axis=0)
    assert shoulder < 0.03
    assert elbow < 0.055
