"""A slider that pushes a block: what the robot feels of it. Integrated here, on a line."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ObjectTrack, Trajectory
from gfm.diagnosis.data.segmentation import WHOLE, airborne, all_segments, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict
from gfm.diagnosis.search.candidates import places
from gfm.diagnosis.search.loop import search_object
from gfm.effects import EffectInstance, find_effect
from gfm.effects.plugins import USUAL_SCALES
from gfm.signals.torque_domain import torque_domain
from gfm.signals.touching import CLEARANCE_M, Touch, resting_pose

SLIDER_KG, BLOCK_KG, GAIN, FRICTION = 2.0, 0.5, 40.0, 0.4
HALF_M, FINGER_M, REST_Z, FIRST_M = 0.04, 0.01, 0.04, 0.12
STEP_S, PERIOD_S, NOISE, POSE_NOISE = 1e-4, 0.01, 5e-4, 2e-4
MODEL = f"""
<mujoco><option cone="elliptic"/>
  <default><geom friction="{FRICTION} 0.002 0.0001"/></default>
  <worldbody>
    <geom name="table" type="plane" size="2 2 0.1" contype="1" conaffinity="2"/>
    <body name="slider" pos="0 0 {REST_Z}"><joint name="j" type="slide" axis="1 0 0"/>
      <geom name="finger" type="sphere" size="{FINGER_M}" mass="{SLIDER_KG}" contype="4"
        conaffinity="2" friction="0.01 0.002 0.0001"/></body>
    <body name="block" pos="{FIRST_M} 0 {REST_Z}"><freejoint/>
      <geom type="box" size="{HALF_M} {HALF_M} {HALF_M}" mass="{BLOCK_KG}" contype="2"
        conaffinity="5"/></body>
  </worldbody>
  <actuator><velocity name="j" joint="j" kv="{GAIN}"/></actuator>
</mujoco>
"""
SPECS = {CommandKind.VELOCITY: mujoco.MjSpec.from_string(MODEL)}


def pushed(told, mass):
    """Returns places of slider and block every PERIOD_S under speeds, shape (T, 2).

    The slider meets the block without rebound, and they part where nothing presses.
    """
    x, v, block, speed, together, out = 0.0, 0.0, FIRST_M, 0.0, False, []
    weight = FRICTION * mass * 9.81
    for command in told:
        out.append((x, block))
        for _ in range(round(PERIOD_S / STEP_S)):
            drive = GAIN * (command - v)
            if together:
                a = (drive - weight * np.sign(v)) / (SLIDER_KG + mass)
                together = mass * a + weight > 0.0 and v > 0.0
            if not together:
                a = drive / SLIDER_KG
                speed = max(speed - FRICTION * 9.81 * STEP_S, 0.0)
            v += a * STEP_S
            x += v * STEP_S
            speed = v if together else speed
            block += speed * STEP_S
            if not together and x > block - HALF_M - FINGER_M and v > speed:
                v = speed = (SLIDER_KG * v + mass * speed) / (SLIDER_KG + mass)
                together = True
    return np.array(out)


def recording(seed, mass):
    """A run of strokes, each a little farther, with the slider going back in between."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 8.0, PERIOD_S)
    there = np.cumsum(rng.uniform(0.1, 0.14, 4))
    told = np.zeros(len(time_s))
    for stroke, far in enumerate(there):
        begin = 2.0 * stroke + 0.4
        for start, way in ((begin, far), (begin + 0.7, -far)):
            phase = np.clip((time_s - start) / 0.6, 0.0, 1.0)
            told += way / 0.6 * (1.0 - np.cos(2.0 * np.pi * phase))
    path = pushed(told, mass)
    stamp_ns = np.round(time_s * 1e9).astype(np.int64)
    poses = np.zeros((len(time_s), 3))
    poses[:, 0], poses[:, 2] = path[:, 1], REST_Z
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=path[:, :1] + NOISE * rng.standard_normal((len(path), 1)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.VELOCITY,
        command_stamp_ns=stamp_ns,
        command=told[:, None],
        object_track=ObjectTrack(
            stamp_ns=stamp_ns[::3],
            position=poses[::3] + POSE_NOISE * rng.standard_normal(poses[::3].shape),
            quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (len(poses[::3]), 1)),
        ),
    )


def rows_of(run, segment):
    size = len(segment.position)
    (first,) = (
        row
        for row in range(len(run.position) - size + 1)
        if np.array_equal(run.position[row : row + size], segment.position)
    )
    return range(first, first + size)


def test_segments_begin_in_the_air_with_the_object_at_rest():
    run = recording(0, BLOCK_KG)
    touch = Touch(SPECS[CommandKind.VELOCITY], run.joint_names)
    assert touch.along(run).any()
    problem = all_segments(SPECS, [run], windows_s=WHOLE, touching=True)
    assert problem.pushing
    assert len(problem.segments) > 2  # of no more than about two seconds
    for segment in problem.segments:
        rows = rows_of(run, segment)
        assert not touch.at(run, rows[0])
        assert any(touch.at(run, row) for row in rows)
        near = np.abs(run.object_track.position[:, 0] - segment.object_pose[0])
        assert near.min() < POSE_NOISE


def test_a_robot_is_judged_by_its_motion_in_the_air():
    run = recording(0, BLOCK_KG)
    touch = Touch(SPECS[CommandKind.VELOCITY], run.joint_names)
    problem = prepared(all_segments(SPECS, [run], windows_s=WHOLE))
    assert not problem.pushing
    assert sum(segment.time_s[-1] for segment in problem.segments) > 4.0
    for segment in problem.segments:
        assert not any(touch.at(run, row) for row in rows_of(run, segment))
    # The model is right there: contacts, softer than those of the truth, have no part in it.
    assert np.mean(problem.residuals([()]) ** 2) < 1.5


def test_what_pushes_back_is_no_torque_that_is_missing_in_the_air():
    run = recording(0, BLOCK_KG)
    touch = Touch(SPECS[CommandKind.VELOCITY], run.joint_names)
    pieces = airborne([run], all_segments(SPECS, [run]))
    assert sum(piece.duration_s for piece in pieces) > 4.0
    for piece in pieces:
        rows = np.searchsorted(run.stamp_ns, piece.stamp_ns)
        np.testing.assert_array_equal(piece.position, run.position[rows])
        assert piece.command is run.command
        assert not any(touch.at(run, int(row)) for row in rows)
    problem = prepared(all_segments(SPECS, [run], windows_s=WHOLE))
    everywhere, free = (
        np.sqrt(np.mean((domain.missing() / domain.noise) ** 2))
        for domain in (torque_domain(problem, [run]), torque_domain(problem, pieces))
    )
    assert everywhere > 2.0 * free


def test_a_robot_that_is_hardly_ever_in_the_air_is_judged_by_all_there_is():
    run = recording(0, BLOCK_KG)
    touching = np.flatnonzero(Touch(SPECS[CommandKind.VELOCITY], run.joint_names).along(run))
    pushing = slice(touching[0] - 10, touching[0] + 50)
    stamps = run.stamp_ns[pushing]
    short = replace(
        run,
        stamp_ns=stamps,
        position=run.position[pushing],
        command_stamp_ns=stamps,
        command=run.command[pushing],
    )
    assert prepared(all_segments(SPECS, [short], windows_s=WHOLE)).pushing
    assert not all_segments(SPECS, [short], touching=True).segments


@pytest.mark.parametrize(("lasts_s", "alone"), [(8.0, True), (2.0, False)])
def test_recordings_that_touch_nothing_judge_by_themselves_where_they_are_long_enough(
    lasts_s, alone
):
    run = recording(0, BLOCK_KG)
    clear = run.time_s < lasts_s
    away = replace(
        run,
        name="away",
        stamp_ns=run.stamp_ns[clear],
        position=run.position[clear] - 1.0,
        command_stamp_ns=run.stamp_ns[clear],
        command=run.command[clear],
        object_track=None,
    )
    problem = all_segments(SPECS, [run, away])
    assert bool(problem.air[0]) is not alone
    assert problem.air[1] == [(0, int(clear.sum()))]
    assert {segment.recording for segment in problem.segments} == ({1} if alone else {0, 1})
    assert [piece.name for piece in airborne([run, away], problem)][-1] == "away"


def test_what_nearly_touches_counts_as_touching():
    run = recording(0, BLOCK_KG)
    touch = Touch(SPECS[CommandKind.VELOCITY], run.joint_names)
    for gap, touches in ((0.5 * CLEARANCE_M, True), (2.0 * CLEARANCE_M, False)):
        place = run.object_track.position[0, 0] - HALF_M - FINGER_M - gap
        still = replace(run, position=np.full_like(run.position, place))
        assert touch.at(still, 0) is touches


def test_contact_is_told_by_where_the_links_are():
    run = recording(0, BLOCK_KG)
    place = run.object_track.position[0, 0] - HALF_M - FINGER_M - 4.0 * CLEARANCE_M
    still = replace(run, position=np.full_like(run.position, place))
    ahead = EffectInstance(
        effect=find_effect("encoder_offset"), joints=("j",), values={"offset": -5.0 * CLEARANCE_M}
    )
    for placed, touches in (((), False), ((ahead,), True)):
        touch = Touch(SPECS[CommandKind.VELOCITY], run.joint_names, placed)
        assert touch.at(still, 0) is touches
    (all_of_it,) = all_segments(SPECS, [still], windows_s=WHOLE).segments
    assert all_of_it.time_s[-1] == pytest.approx(still.duration_s)
    assert prepared(all_segments(SPECS, [run])).air
    assert not all_segments(SPECS, [still], windows_s=WHOLE).air


def test_where_no_pose_was_taken_around_a_time_the_nearest_counts():
    run = recording(0, BLOCK_KG)
    track = run.object_track
    late = ObjectTrack(
        stamp_ns=track.stamp_ns[100:],
        position=track.position[100:],
        quaternion=track.quaternion[100:],
    )
    told = resting_pose(replace(run, object_track=late), int(run.stamp_ns[0]))
    np.testing.assert_array_equal(told[:3], late.position[0])


def test_only_a_robot_that_pushes_feels_an_object():
    mass = find_effect("object_mass")
    assert places(mass, ["j"], [USUAL_SCALES]) == []
    assert [place.joints for place in places(mass, ["j"], [USUAL_SCALES], pushing=True)] == [()]
    without = replace(recording(0, BLOCK_KG), object_track=None)
    assert not all_segments(SPECS, [without], windows_s=WHOLE, touching=True).pushing


@pytest.mark.slow
def test_what_a_robot_feels_is_asked_only_for_what_it_shall_tell():
    runs = [recording(seed, 2.0 * BLOCK_KG) for seed in range(2)]
    problem = prepared(all_segments(SPECS, runs, touching=True))
    asked = {
        name: search_object(problem, runs, [name], lambda _: None)
        for name in ("object_mass", "object_friction")
    }
    for name, found in asked.items():
        assert {one.effect.name for one in found.fit.effects} <= {name}
    assert asked["object_mass"].fit.cost < asked["object_friction"].fit.cost


@pytest.mark.slow
def test_a_mass_is_named_by_what_it_takes_to_push_it():
    runs = [recording(seed, 2.0 * BLOCK_KG) for seed in range(4)]
    said = diagnose(SPECS, runs[:3], runs[3:])
    # The model's contacts are softer than these: what that leaves may have a name beside it.
    assert said.effects[0].effect == "object_mass"
    assert said.effects[0].parameters["mass"].value == pytest.approx(BLOCK_KG, rel=0.15)
    assert said.verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
    assert "object_mass" not in {spot.effect for spot in said.blind_spots}
