"""Recordings of robots that others made pass every check, and their known flaws are found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gfm.api.models import load_specs
from gfm.api.refusals import check_usable
from gfm.core import RecordingError, Trajectory
from gfm.signals.examine import findings_of
from gfm.signals.lateness import delays
from gfm.sim.plant import make_plant

pytestmark = pytest.mark.slow

MODELS = Path(__file__).resolve().parents[2] / "models"
SETS = {
    "xl330": ("bam_xl330/raw/*.json.gz", MODELS / "xl330_pendulum.xml"),
    "double_pendulum": ("dfki_double_pendulum/C1_*.csv.gz", MODELS / "double_pendulum_c1.xml"),
    "so101": (
        "so101/*_*.csv.gz",
        MODELS.parents[1] / "shared" / "data" / "measured" / "so101" / "model.xml",
    ),
}
Measured = Callable[[str, str], list[Trajectory]]


@pytest.mark.parametrize("name", SETS)
def test_measured_recordings_are_used_and_hardly_doubted(measured: Measured, name: str) -> None:
    pattern, model = SETS[name]
    recordings = measured(pattern, f"{name}.toml")
    specs = load_specs([model])
    files = [(Path(one.name), one) for one in recordings]
    check_usable(specs, files[1:], files[:1])
    (plant,) = (make_plant(spec, recordings[0].joint_names) for spec in specs.values())
    doubts = {f.what for one in recordings for f in findings_of(one, plant) if f.doubtful}
    assert doubts <= {"position never changes"}


@pytest.mark.parametrize("name", SETS)
def test_the_same_recordings_in_degrees_are_refused(measured: Measured, name: str) -> None:
    pattern, model = SETS[name]
    recordings = measured(pattern, f"{name}.toml")
    spoilt = [replace(one, position=np.degrees(one.position), velocity=None) for one in recordings]
    with pytest.raises(RecordingError, match="degrees"):
        check_usable(load_specs([model]), [(Path(one.name), one) for one in spoilt], [])


def test_measured_torques_of_the_double_pendulum_are_four_milliseconds_late(
    measured: Measured,
) -> None:
    late = delays(measured(SETS["double_pendulum"][0], "double_pendulum.toml"))
    np.testing.assert_allclose(late.seconds, 0.004, atol=1.5e-3)
