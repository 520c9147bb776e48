"""The command `gfm robot`."""

from __future__ import annotations

import pytest

from gfm.core import ConfigError
from gfm.launch.robot_command import question
from gfm_wire import PowerAction, PowerRobot, ScaleSpeed, StopRobot


def test_it_asks_the_bridge_to_stop_or_to_slow_down() -> None:
    assert question("stop", None, "smoke") == ("robot/stop", StopRobot(reason="smoke"))
    assert question("speed", 0.0, "") == ("robot/speed", ScaleSpeed(scale=0.0))


@pytest.mark.parametrize("action", PowerAction)
def test_it_switches_the_drives(action: PowerAction) -> None:
    assert question(action, None, "") == ("robot/power", PowerRobot(action=action))


@pytest.mark.parametrize(
    ("what", "scale", "words"),
    [
        ("stop", 1.0, "stop has the scale 1, expected none"),
        ("enable", 1.0, "enable has the scale 1, expected none"),
        ("speed", None, "speed has no scale, expected 0 to 1"),
        ("speed", 1.5, r"speed has the scale 1\.5, expected 0 to 1"),
        ("speed", float("nan"), "speed has the scale nan, expected 0 to 1"),
    ],
)
def test_what_makes_no_sense_is_refused(what: str, scale: float | None, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        question(what, scale, "")
