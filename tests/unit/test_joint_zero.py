"""An encoder that counts from elsewhere: whoever drives by a corrected model has a guard by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gfm.cli import main
from gfm.core import CommandKind, ConfigError, Observation, UnreachableError
from gfm.core.checks import Array
from gfm.diagnosis.output.correction import model_pair
from gfm.envs.registry import nominal_cell
from gfm.experiments import drive_robot
from gfm.launch import SystemSpec
from gfm.report.files import model_texts, write_texts
from gfm.service import parse_config
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm_robot_bridge import __main__ as bridge_command
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.limits import Reason
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.plan import SPACING_S, Plan
from gfm_robot_bridge.sawyer_guard import sawyer_guard

ZERO = np.array([0.0, 0.05, 0.0, -0.03, 0.0, 0.0, 0.0])


def guard(*zero: float) -> Guard:
    config = BridgeConfig(name="bridge", task="pose", joint_zero_rad=zero)
    return sawyer_guard(config, MirrorRobot(JOINT_NAMES))


def reasons(guard: Guard, places: Array, speeds: Array) -> list[Reason]:
    """Returns what a guard says of speeds at places that are reported, shape (N, J) each."""
    said = []
    for place, speed in zip(places, speeds, strict=True):
        seen = Observation(
            joint_names=JOINT_NAMES,
            position=place,
            velocity=speed,
            effort=np.zeros(len(JOINT_NAMES)),
            stamp_ns=0,
        )
        guard.look(seen)
        plan = Plan(kind=CommandKind.VELOCITY, values=speed[None], spacing_s=SPACING_S)
        said.append(guard.reason(plan))
    return said


def test_a_guard_that_knows_the_zeros_judges_as_where_the_arm_is() -> None:
    rng = np.random.default_rng(0)
    places = READY + rng.uniform(-0.3, 0.3, (60, len(JOINT_NAMES)))
    speeds = rng.uniform(-0.3, 0.3, places.shape)
    expected = reasons(guard(), places, speeds)
    assert {Reason.NONE, Reason.COLLISION} <= set(expected)
    assert reasons(guard(*ZERO), places + ZERO, speeds) == expected
    assert reasons(guard(), places + ZERO, speeds) != expected


@pytest.mark.parametrize("zero", [(0.05,), (*ZERO, 0.0), (0.6, *ZERO[1:]), (np.nan, *ZERO[1:])])
def test_zeros_that_cannot_be_are_refused(zero: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=r"joint_zero_rad is .* expected 7 angles"):
        BridgeConfig(name="bridge", joint_zero_rad=zero)


def bridge_that_is_started(
    words: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> BridgeConfig:
    """Returns the settings of the bridge that `gfm drive` starts."""
    systems: list[SystemSpec] = []

    def starts(system: SystemSpec, *_: object, **__: object) -> None:
        systems.append(system)
        raise UnreachableError("nothing", 0.0)

    monkeypatch.setattr(drive_robot, "Supervisor", starts)
    assert main(["drive", "--task", "pose", *words, "--out", str(folder)]) == 1
    bridge = next(one for one in systems[0].processes if one.role == "robot_bridge")
    configs: list[BridgeConfig] = []
    monkeypatch.setattr(
        bridge_command,
        "service_main",
        lambda parser, config, _, argv: configs.append(parse_config(parser, config, argv)) or 0,
    )
    bridge_command.main(systems[0].arguments(bridge))
    return configs[0]


def test_the_bridge_of_a_drive_gets_the_zeros_of_its_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = nominal_cell("pose_matching")
    for joint, zero in zip(JOINT_NAMES, ZERO, strict=True):
        spec.joint(joint).ref = zero
    write_texts(tmp_path, model_texts("corrected", model_pair(spec, ())))
    words = ["--model", str(tmp_path / "corrected.xml")]
    told = bridge_that_is_started(words, tmp_path / "corrected", monkeypatch)
    np.testing.assert_allclose(told.joint_zero_rad, ZERO, atol=1e-7)
    plain = bridge_that_is_started([], tmp_path / "plain", monkeypatch)
    assert plain.joint_zero_rad == (0.0,) * len(JOINT_NAMES)
