"""Bridge and a Sawyer behind a rosbridge, as processes: driven, and stopped in every way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest

pytest.importorskip("websockets")

from rosbridge_cell import STILL, Cell, end, eventually

from gfm.core import CommandKind, RefusedError
from gfm.sim.sawyer import JOINT_NAMES
from gfm_wire import PowerAction

#: All of it is in real time: where others keep a machine busy, the arm stands still meanwhile.
pytestmark = pytest.mark.slow

LINE = ("--clock-ahead-s", "7", "--latency-s", "0.002", "--jitter-s", "0.002")

#: On a busy machine a process may stand still for a while; nothing here is about that.
PATIENT = """
watchdog_periods = 10
command_age_s = 2.0
report_age_s = 10.0
"""


@pytest.fixture(scope="module")
def running(tmp_path_factory) -> Iterator[Cell]:
    folder = tmp_path_factory.mktemp("cell")
    settings = folder / "bridge.toml"
    settings.write_text(PATIENT)
    with ExitStack() as stack:
        yield Cell(folder, stack, LINE, ("--config", str(settings)))


@pytest.fixture
def cell(running) -> Cell:
    running.make_ready()
    return running


def assert_goes_at(cell: Cell, speed: float) -> None:
    """Drives it until it is as fast as it is told; an answer comes a period after its command."""
    cell.command(speed, begins=True)
    eventually(
        lambda: np.abs(cell.command(speed).velocity - speed).max() < 0.03, "it is as fast as told"
    )


def test_a_robot_that_is_off_is_not_driven(cell):
    cell.power(PowerAction.DISABLE)
    eventually(lambda: "not enabled" in cell.status().note, "the bridge sees it")
    assert "it is not enabled: `gfm robot enable`" in cell.refusal(begins=True)
    cell.power(PowerAction.ENABLE)
    eventually(lambda: cell.status().note == "the robot may be driven", "the bridge sees it")
    assert cell.command(0.0, begins=True).joint_names == JOINT_NAMES


def test_it_is_driven_in_velocity_mode_and_stops_by_silence(cell):
    assert_goes_at(cell, 0.1)
    applied = cell.command(0.1).applied
    assert applied is not None
    assert applied.kind is CommandKind.VELOCITY
    eventually(lambda: "no command for" in cell.status().note, "the bridge sees it")
    eventually(lambda: cell.witness.speed() < STILL, "the arm is still")
    assert "no command for" in cell.refusal()
    assert cell.command(0.0, begins=True).applied is not None


def test_the_button_stops_it_and_only_a_person_brings_it_back(cell):
    cell.drive(0.1, 0.5)
    cell.witness.press(pressed=True)
    eventually(lambda: "e-stop button is pressed" in cell.status().note, "the bridge sees it")
    assert "e-stop button is pressed" in cell.refusal(begins=True)
    eventually(lambda: cell.witness.speed() < STILL, "the arm is still")
    with pytest.raises(RefusedError, match="e-stop button is pressed: release it first"):
        cell.power(PowerAction.RESET)
    cell.witness.press(pressed=False)
    eventually(lambda: "stopped by its e-stop button" in cell.status().note, "it is out")
    with pytest.raises(RefusedError, match="not enabled while it is stopped"):
        cell.power(PowerAction.ENABLE)
    cell.power(PowerAction.RESET)
    eventually(lambda: "not enabled" in cell.status().note, "the bridge sees it")
    assert "not enabled" in cell.refusal(begins=True)
    cell.power(PowerAction.ENABLE)
    eventually(lambda: cell.status().note == "the robot may be driven", "the bridge sees it")
    assert "a command with number 0 begins again" in cell.refusal()
    assert_goes_at(cell, -0.1)


def test_a_cut_line_stops_it_and_is_told(cell):
    cell.drive(0.1, 0.5)
    failures = cell.status().counters["robot_failures"]
    port = cell.cut()
    lost = f"no connection to rosbridge at 127.0.0.1:{port}: "
    eventually(lambda: lost in cell.status().note, "the bridge sees it")
    assert lost in cell.refusal()
    eventually(lambda: cell.witness.speed() < STILL, "the arm is still")
    assert cell.status().counters["robot_failures"] > failures
    cell.mend()
    assert "a command with number 0 begins again" in cell.refusal()
    assert_goes_at(cell, -0.1)


def test_a_bridge_that_is_told_to_end_leaves_the_arm_at_rest(cell):
    cell.drive(0.1, 0.5)
    assert end(cell.bridge) == 0
    assert cell.witness.speed() < STILL
