"""Without a mapping, `gfm import` offers one, with a reason for every line, or asks."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm import cli
from gfm.core import CommandKind, ConfigError, RecordingError
from gfm.experiments import import_command
from gfm.importing import imported, mapping_of
from gfm.importing.guess import Asked, Robot, guessed_mapping
from gfm.recording import read_recording
from made_bags import (
    BEGAN_NS,
    COMMAND,
    JOINT_STATE,
    JOINTS,
    MULTI_ARRAY,
    POSITION,
    STAMP_NS,
    TRAJECTORY,
    Maker,
    Message,
    arrays,
    controller_states,
    joint_states,
    states,
    trajectories,
    write,
)
from made_datasets import ACTION, STATE, dataset

RANGES = {"shoulder": (-1.0, 3.0), "elbow": (-4.0, 4.0)}
ARM = Robot(joints=("shoulder", "elbow"), command_kind=CommandKind.POSITION, ranges=RANGES)
SO101 = Robot(
    joints=("shoulder_pan", "gripper"),
    command_kind=CommandKind.POSITION,
    ranges={"shoulder_pan": (-1.0, 3.0), "gripper": (-0.2, 1.8)},
)


def guess(path: Path, robot: Robot = ARM, **asked: Any) -> str:
    return guessed_mapping(path, robot, Asked(**asked))


def run_by_guess(path: Path, robot: Robot = ARM, **asked: Any) -> Any:
    text = guess(path, robot, **asked)
    return next(iter(imported([path], mapping_of(text, "guess"))))


def assert_every_line_has_a_reason(text: str) -> None:
    for line in text.splitlines():
        assert not line or line.startswith("[") or "# " in line, line


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
@pytest.mark.parametrize("told", [arrays, trajectories, controller_states])
def test_a_bag_needs_no_mapping(
    tmp_path: Path, kind: str, told: Callable[[Maker], list[Message]]
) -> None:
    path = write(tmp_path, kind, lambda maker: states(maker) + told(maker))
    assert_every_line_has_a_reason(guess(path))
    run = run_by_guess(path)
    np.testing.assert_array_equal(run.position, POSITION[:, ::-1])
    order = slice(None) if told is arrays else slice(None, None, -1)  # arrays name no joints
    np.testing.assert_array_equal(run.command, COMMAND[:, order])


def test_commands_without_names_go_to_the_joints_that_follow_them(tmp_path: Path) -> None:
    time_s = 1e-9 * (STAMP_NS - BEGAN_NS)
    swing = np.column_stack([np.sin(3.0 * time_s), np.cos(3.0 * time_s)])

    def messages(maker: Maker) -> list[Message]:
        made = []
        for t, q in zip(STAMP_NS, swing, strict=True):
            state = maker.joint_state(t, JOINTS, position=q)
            made.append(("/joint_states", JOINT_STATE, t, state))
            made.append(("/arm/commands", MULTI_ARRAY, t, maker.multi_array(q + 0.1)))
        return made

    path = write(tmp_path, "mcap", messages)
    assert "elbow follows it (0.1 apart), and not the model's order" in guess(path)
    run = run_by_guess(path)
    assert run.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(run.command, swing[:, ::-1] + 0.1)


def test_joint_states_are_measured_even_beside_a_controller(tmp_path: Path) -> None:
    def renamed(maker: Maker) -> list[Message]:
        return [("/ctrl/joint_states", *rest) for _, *rest in states(maker)]

    path = write(tmp_path, "mcap", lambda maker: renamed(maker) + arrays(maker))
    assert 'states = "/ctrl/joint_states"' in guess(path)


def test_the_filled_field_of_commanded_joint_states_is_their_kind(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", lambda maker: states(maker) + joint_states(maker))
    assert run_by_guess(path).command_kind is CommandKind.EFFORT


def test_commands_without_stamps_bring_their_own_clock_or_that_of_the_recorder(
    tmp_path: Path,
) -> None:
    def simulated(maker: Maker) -> list[Message]:
        made = []
        for topic, kind, log_ns, _ in states(maker):
            stamp_ns = log_ns - BEGAN_NS
            position = POSITION[len(made)]
            made.append(
                (topic, kind, log_ns, maker.joint_state(stamp_ns, JOINTS, position=position))
            )
        return made + arrays(maker)

    text = guess(write(tmp_path, "mcap", simulated))
    assert "headers run on another clock" in text
    assert "command_time" not in text


def two_robots(maker: Maker) -> list[Message]:
    left = [("/left/joint_states", *rest) for _, *rest in states(maker)]
    return states(maker) + arrays(maker) + left


def test_one_word_tells_two_arms_of_one_robot_apart(tmp_path: Path) -> None:
    names = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]

    def two_arms(maker: Maker) -> list[Message]:
        both = [
            (topic, kind, log_ns, maker.joint_state(stamp_ns, names, position=[*q, *(q + 1.0)]))
            for (topic, kind, log_ns, _), stamp_ns, q in zip(
                states(maker), STAMP_NS, POSITION, strict=True
            )
        ]
        told = [
            (f"/{side}_arm/commands", *rest)
            for side in ("left", "right")
            for _, *rest in arrays(maker)
        ]
        return both + told

    path = write(tmp_path, "mcap", two_arms)
    with pytest.raises(RecordingError, match=r"on /left_arm/commands, /right_arm/commands"):
        guess(path)
    for side, shift in (("left", 0.0), ("right", 1.0)):
        assert f'commands = "/{side}_arm/commands"' in guess(path, use=(side,))
        run = run_by_guess(path, use=(side,))
        np.testing.assert_array_equal(run.position[:, ::-1], POSITION + shift)


def test_two_robots_in_one_bag_are_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", two_robots)
    with pytest.raises(RecordingError, match=r"on /arm/joint_states, /left/joint_states; .*--use"):
        guess(path)
    assert 'states = "/left/joint_states"' in guess(path, use=("/left/joint_states",))


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (states, "no topic with commands of the model's joints"),
        (arrays, "no topic with joint states of the model's joints"),
    ],
)
def test_a_bag_without_states_or_commands_is_refused_with_its_topics(
    tmp_path: Path, told: Callable[[Maker], list[Message]], words: str
) -> None:
    with pytest.raises(RecordingError, match=words + ".*topics in the bag: /arm/"):
        guess(write(tmp_path, "mcap", told))


def plan(maker: Maker) -> list[Message]:
    points = maker.trajectory(STAMP_NS[0], JOINTS, [[0, 0], [1, 1]])
    return [("/arm/plan", TRAJECTORY, STAMP_NS[0], points)]


def test_a_plan_is_passed_over_where_a_controller_tells_the_set_points(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", lambda m: states(m) + plan(m) + controller_states(m))
    np.testing.assert_array_equal(run_by_guess(path).command, COMMAND[:, ::-1])
    (tmp_path / "alone").mkdir()
    path = write(tmp_path / "alone", "mcap", lambda m: states(m) + plan(m))
    with pytest.raises(RecordingError, match="topic /arm/plan: message 0: has 2 points"):
        guess(path)


def scaled(tmp_path: Path, factor: float, **spoiled: float) -> Path:
    """Returns a dataset whose shoulder moves that much, and whose gripper opens to 100."""
    state, action = (factor * one / np.abs(STATE).max() for one in (STATE, ACTION))
    for one in (state, action):
        one[:, :, 1] = np.linspace(0.0, 100.0, one.shape[1])
        np.clip(one, -spoiled.get("clip", np.inf), spoiled.get("clip", np.inf), out=one)
    return dataset(tmp_path / "pick", "v3.0", state=state.astype("f4"), action=action.astype("f4"))


def test_lerobot_degrees_are_told_by_their_size(tmp_path: Path) -> None:
    path = scaled(tmp_path, 170.0)
    text = guess(path, SO101)
    assert "# degrees: reaches" in text
    assert_every_line_has_a_reason(text)
    run = run_by_guess(path, SO101)
    there = run_by_guess(path, SO101, unit="rad")
    np.testing.assert_allclose(run.position[:, 0], np.radians(there.position[:, 0]), rtol=1e-12)
    opened = np.linspace(-0.2, 1.8, len(run.position))
    np.testing.assert_allclose(run.position[:, 1], opened, atol=1e-6)


@pytest.mark.parametrize(
    "names",
    [["main_shoulder_pan", "main_gripper"], {"motors": ["main_shoulder_pan", "main_gripper"]}],
)
def test_lerobot_datasets_of_version_2_have_other_names(tmp_path: Path, names: Any) -> None:
    path = dataset(tmp_path / "pick", "v2.1", names=names)
    run = run_by_guess(path, SO101, unit="rad")
    assert run.joint_names == ("shoulder_pan", "gripper")
    np.testing.assert_array_equal(run.position, STATE[0])
    np.testing.assert_array_equal(run.command, ACTION[0])


def test_lerobot_normalised_positions_are_told_by_their_ends(tmp_path: Path) -> None:
    path = scaled(tmp_path, 170.0, clip=100.0)
    assert "shoulder_pan ends exactly at 100, where LeRobot clips" in guess(path, SO101)
    run = run_by_guess(path, SO101)
    there = run_by_guess(path, SO101, unit="rad")
    np.testing.assert_allclose(run.position[:, 0], 1.0 + there.position[:, 0] / 50.0, rtol=1e-12)


def test_lerobot_rad_are_told_by_their_size(tmp_path: Path) -> None:
    path = scaled(tmp_path, 3.0)
    run = run_by_guess(path, SO101)
    assert np.abs(run.position[:, 0]).max() <= 3.0


def test_a_unit_that_cannot_be_told_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"shoulder_pan reaches .*--unit rad\|degrees\|normalised"
    ):
        guess(scaled(tmp_path, 80.0), SO101)


def test_normalised_positions_need_a_range(tmp_path: Path) -> None:
    robot = Robot(joints=("shoulder_pan",), command_kind=CommandKind.POSITION)
    with pytest.raises(ConfigError, match="shoulder_pan is normalised, and has no range"):
        guess(scaled(tmp_path, 170.0, clip=100.0), robot)


def csv_file(tmp_path: Path, head: str, rows: Any) -> Path:
    path = tmp_path / "run.csv"
    path.write_text("\n".join([head, *(",".join(repr(float(x)) for x in row) for row in rows)]))
    return path


TIME_MS = 10.0 * np.arange(30)


@pytest.mark.parametrize(
    "head",
    [
        "t_ms,q_shoulder,q_elbow,shoulder_cmd,elbow_cmd",
        "time,shoulder.pos,elbow.pos,goal.shoulder,goal.elbow",
        "timestamp,qShoulder,qElbow,desiredShoulder,desiredElbow",
        "t,q1,q2,q_des1,q_des2",
        "t,shoulder_joint,elbow_joint,target_shoulder_joint,target_elbow_joint",
    ],
)
def test_columns_are_told_by_their_names(tmp_path: Path, head: str) -> None:
    path = csv_file(tmp_path, head, np.column_stack([TIME_MS, POSITION, COMMAND]))
    assert_every_line_has_a_reason(guess(path))
    run = run_by_guess(path)
    np.testing.assert_array_equal(run.position, POSITION)
    np.testing.assert_array_equal(run.command, COMMAND)
    assert run.period_s == pytest.approx(0.01)


def test_degrees_are_told_by_a_name(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, POSITION, COMMAND])
    path = csv_file(tmp_path, "t,q1_deg,q2_deg,q_des1,q_des2", table)
    assert "degrees, as the name says" in guess(path)
    np.testing.assert_array_equal(run_by_guess(path).position, np.radians(1.0) * POSITION)


def test_names_may_give_each_joint_a_unit_of_its_own(tmp_path: Path) -> None:
    degrees = np.array([np.degrees(1.0), 1.0])
    speed = np.ones((30, 2))
    table = np.column_stack([TIME_MS, degrees * POSITION, speed, COMMAND * degrees[::-1]])
    head = "t,shoulder_pos_deg,elbow_pos_rad,shoulder_vel,elbow_vel,shoulder_cmd_rad,elbow_cmd_deg"
    run = run_by_guess(csv_file(tmp_path, head, table))
    np.testing.assert_allclose(run.position, POSITION)
    np.testing.assert_allclose(run.velocity, speed / degrees)
    np.testing.assert_allclose(run.command, COMMAND)
    said = run_by_guess(csv_file(tmp_path, head, table), unit="rad")
    np.testing.assert_allclose(said.position, degrees * POSITION)


def test_velocities_may_have_another_unit_than_positions(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, np.degrees(POSITION), np.ones((30, 2)), np.degrees(COMMAND)])
    head = "t,q1 [deg],q2 [deg],dq1 [rad/s],dq2 [rad/s],q_des1,q_des2"
    path = csv_file(tmp_path, head, table)
    assert "rad per second, as the name says" in guess(path)
    run = run_by_guess(path)
    np.testing.assert_allclose(run.position, POSITION)
    np.testing.assert_allclose(run.command, COMMAND)
    np.testing.assert_array_equal(run.velocity, np.ones((30, 2)))


def test_columns_that_say_no_unit_follow_their_joint_then_the_other_joints(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, POSITION, COMMAND])
    head = "t,shoulder_pos_deg,elbow_pos,shoulder_cmd,elbow_cmd"
    run = run_by_guess(csv_file(tmp_path, head, table))
    np.testing.assert_allclose(run.position, np.radians(POSITION))
    np.testing.assert_allclose(run.command, np.radians(COMMAND))


@pytest.mark.parametrize(("factors", "word"), [((57.3, 1.0), "measured"), ((1.0, 57.3), "comm")])
def test_mixed_units_are_refused(tmp_path: Path, factors: tuple[float, float], word: str) -> None:
    measured, told = factors
    table = np.column_stack([TIME_MS, measured * POSITION, told * (POSITION + 0.1)])
    path = csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", table)
    with pytest.raises(ConfigError, match=f"shoulder: {word}.* positions are .* as wide"):
        guess(path)


@pytest.mark.parametrize(
    ("time_s", "words"),
    [
        (np.where(np.arange(30) < 20, 0.01, 0.001) * np.arange(30), "row 21 is 0.02 after 0.19"),
        (0.001 * np.repeat(np.arange(15), 2), "row 2 is 0 after 0"),
        (1e-8 * np.arange(30), "rows are 1e-08 apart; expected 0.0002 to 0.2 s"),
    ],
)
def test_a_clock_that_cannot_be_right_is_named(tmp_path: Path, time_s: Any, words: str) -> None:
    path = csv_file(tmp_path, "time,q1,q2,u1,u2", np.column_stack([time_s, POSITION, COMMAND]))
    with pytest.raises(RecordingError, match=f"column time: {words}"):
        guess(path)


def test_joints_that_the_model_lacks_are_named_as_not_read(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, POSITION, COMMAND, TIME_MS])
    head = "t,shoulder_pos,wrist_pos,shoulder_cmd,wrist_cmd,voltage"
    one = Robot(joints=("shoulder",), command_kind=CommandKind.POSITION)
    assert "\n# not read: wrist_pos, wrist_cmd\n" in guess(csv_file(tmp_path, head, table), one)
    whole = csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", table[:, :5])
    assert "not read" not in guess(whole)
    fingers = np.ones((30, 11))
    head = ",".join(["t,q_shoulder,goal_shoulder", *(f"q_finger{i}" for i in range(11))])
    text = guess(
        csv_file(tmp_path, head, np.column_stack([table[:, :2], COMMAND[:, 0], fingers])), one
    )
    assert "q_finger7 and 3 more" in text
    assert "q_finger8" not in text


@pytest.mark.parametrize("form", ["{}T{}", "{} {}", "{}T{}Z", "{}T{}+00:00"])
def test_times_may_be_dates(tmp_path: Path, form: str) -> None:
    dates = [form.format("2024-05-01", f"12:00:{0.01 * k:09.6f}") for k in range(30)]
    table = np.column_stack([POSITION, COMMAND])
    rows = [
        ",".join([date, *map(repr, row)]) for date, row in zip(dates, table.tolist(), strict=True)
    ]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["time,q1,q2,q_des1,q_des2", *rows]))
    run = run_by_guess(path)
    np.testing.assert_allclose(run.stamp_ns / 1e9 - 1714564800.0, 0.01 * np.arange(30), atol=1e-6)


def test_what_is_no_signal_is_passed_over(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, POSITION, COMMAND, COMMAND])
    head = "t,q1,q2,q_des1,q_des2,torque_enable1,torque_enable2"
    assert run_by_guess(csv_file(tmp_path, head, table)).effort is None


def test_rows_of_json_are_the_only_list_in_it(tmp_path: Path) -> None:
    table = np.column_stack([0.001 * TIME_MS, POSITION, COMMAND]).tolist()
    head = ["t", "q1", "q2", "goal1", "goal2"]
    rows = [dict(zip(head, row, strict=True)) for row in table]
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"robot": "arm", "rows": rows, "tags": []}))
    np.testing.assert_array_equal(run_by_guess(path).position, POSITION)
    path.write_text(json.dumps({"rows": rows, "more": rows}))
    with pytest.raises(RecordingError, match="rows under one of rows, more"):
        guess(path)


def test_joints_in_two_units_are_asked_for(tmp_path: Path) -> None:
    scales = [40.0, 0.5]
    table = np.column_stack([TIME_MS, scales * POSITION, scales * COMMAND])
    path = csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", table)
    with pytest.raises(ConfigError, match=r"shoulder is in degrees, .*; elbow reaches .* `scale`"):
        guess(path)
    table[:, [2, 4]] = 0.5  # stands still: its unit is that of the others
    assert "degrees: as rad shoulder leaves" in guess(
        csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", table)
    )


def test_degrees_of_a_table_are_told_by_the_models_ranges(tmp_path: Path) -> None:
    table = np.column_stack([TIME_MS, 40.0 * POSITION, 40.0 * COMMAND])
    path = csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", table)
    assert "degrees: as rad shoulder leaves the model's range" in guess(path)
    np.testing.assert_allclose(run_by_guess(path).position, np.radians(40.0 * POSITION))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("x,q1,q2,q_des1,q_des2", "no column tells the time"),
        ("t,a,b,c,d", "no column is the position of a joint; .*shoulder, elbow.* among t, a"),
        ("t,q1,q2,a,b", "no column is the position and command of a joint"),
        ("t,q1,q2,q_raw1,q_raw2", "position of shoulder: q1, q_raw1 fit; .*--use COLUMN"),
        ("t,q1,q2,goal_shoulder,shoulder_cmd", "command of shoulder: goal_.*, shoulder_cmd fit"),
    ],
)
def test_what_no_name_tells_is_asked_for(tmp_path: Path, head: str, words: str) -> None:
    path = csv_file(tmp_path, head, np.column_stack([TIME_MS, POSITION, COMMAND]))
    with pytest.raises((RecordingError, ConfigError), match=words):
        guess(path)


def test_a_format_that_no_name_tells_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "run.docx").write_text("t")
    with pytest.raises(RecordingError, match=r"absent\.csv: no such file"):
        guess(tmp_path / "absent.csv")
    with pytest.raises(RecordingError, match=r"name does not tell the format; expected \.csv"):
        guess(tmp_path / "run.docx")


def test_what_says_that_it_was_measured_comes_before_what_was_filtered(tmp_path: Path) -> None:
    columns = [TIME_MS, 2.0 * POSITION, POSITION, COMMAND]
    head = "t,pos_filt1,pos_filt2,pos_meas1,pos_meas2,q_des1,q_des2"
    path = csv_file(tmp_path, head, np.column_stack(columns))
    assert "rather than pos_filt1, it says measured" in guess(path)
    np.testing.assert_array_equal(run_by_guess(path).position, POSITION)
    filtered = run_by_guess(path, use=("pos_filt",))
    np.testing.assert_array_equal(filtered.position, 2.0 * POSITION)


def test_two_measured_columns_are_still_asked_about(tmp_path: Path) -> None:
    columns = [TIME_MS, 2.0 * POSITION, POSITION, COMMAND]
    head = "t,pos_actual1,pos_actual2,pos_meas1,pos_meas2,q_des1,q_des2"
    path = csv_file(tmp_path, head, np.column_stack(columns))
    with pytest.raises(ConfigError, match="position of shoulder: pos_actual1, pos_meas1 fit"):
        guess(path)


MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="shoulder" range="-1 3" limited="true"/> <geom size="0.1"/>
      <body pos="1 0 0"> <joint name="elbow" axis="0 1 0"/> <geom size="0.1"/> </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="shoulder" kp="10"/> <position joint="elbow" kp="10"/>
  </actuator>
</mujoco>
"""


def run(*words: str | Path) -> int:
    parser = argparse.ArgumentParser()
    import_command.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["import", *(str(word) for word in words)])
    return int(arguments.run(arguments))


def test_the_command_offers_a_mapping_and_imports_with_yes(tmp_path: Path, capsys: Any) -> None:
    path = csv_file(
        tmp_path, "t,q1,q2,q_des1,q_des2", np.column_stack([TIME_MS, POSITION, COMMAND])
    )
    (tmp_path / "arm.xml").write_text(MODEL)
    out = tmp_path / "out"
    assert run(path, "--model", tmp_path / "arm.xml", "--out", out) == 0
    offered, note = capsys.readouterr()
    assert "nothing was imported" in note
    assert not out.exists()
    assert run(path, "--model", tmp_path / "arm.xml", "--out", out, "--yes") == 0
    assert capsys.readouterr().out.startswith(offered)
    np.testing.assert_array_equal(read_recording(out / "run.mcap").position, POSITION)
    (tmp_path / "map.toml").write_text(offered)
    assert run(path, "--mapping", tmp_path / "map.toml", "--out", tmp_path / "again") == 0
    with pytest.raises(ConfigError, match="no --out given"):
        run(path, "--model", tmp_path / "arm.xml", "--yes")


def test_a_command_that_copies_the_measurement_is_told(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "arm.xml").write_text(MODEL)
    copied = np.roll(POSITION, -1, axis=0)
    path = csv_file(tmp_path, "t,q1,q2,q_des1,q_des2", np.column_stack([TIME_MS, POSITION, copied]))
    assert run(path, "--model", tmp_path / "arm.xml", "--out", tmp_path / "out", "--yes") == 0
    warned = capsys.readouterr().err
    assert "warning: " in warned
    assert "the command of shoulder, elbow is a copy of what was measured" in warned
    assert warned.count("\n") == 1


def test_what_belongs_to_a_guess_is_refused_without_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--yes; expected --model"):
        run(tmp_path / "run.csv", "--mapping", tmp_path / "map.toml", "--yes")


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_bad_input_ends_with_one_line_and_status_2(tmp_path: Path, capfd: Any, kind: str) -> None:
    (tmp_path / "arm.xml").write_text(MODEL)
    path = write(tmp_path, kind, lambda maker: states(maker) + arrays(maker))
    file = path if path.is_file() else next(path.glob(f"*.{kind}"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    words = ["import", path, "--model", tmp_path / "arm.xml", "--yes", "--out", tmp_path / "out"]
    assert cli.main([str(word) for word in words]) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert str(path) in printed.err
    assert not (tmp_path / "out").exists()
