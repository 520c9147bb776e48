"""Recordings made by an integrator of our own, replayed, predicted and explained by forces."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ObjectTrack, RecordingError, Trajectory
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.features import make_features
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import make_replay
from gfm.sim.residual import residual_forces
from gfm.sim.rollout import rollouts
from gfm.sim.smoothing import smoothing_spline

INERTIA, DAMPING, KP, KV = 0.5, 0.2, 40.0, 4.0
#: Largest error of the recovered torque, N m: all but RK4 also make up for their own steps' error.
TOLERANCES = {"Euler": 0.05, "implicitfast": 0.05, "implicit": 0.05, "discrete": 0.05, "RK4": 0.02}


def hinge(integrator="RK4", gear=1.0):
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><option timestep="0.002" integrator="{integrator}"/><worldbody><body>
      <joint name="a" axis="0 0 1" armature="{INERTIA}" damping="{DAMPING}"/>
      <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
      <actuator><position name="a" joint="a" kp="{KP}" kv="{KV}" gear="{gear}"
        forcerange="-30 30"/></actuator></mujoco>""")


def hybrid(integrator="RK4"):
    return HybridModel(models={CommandKind.POSITION: hinge(integrator)})


def no_torque(_t, _q, _v):
    return 0.0


def record(torque=no_torque, *, noise=0.0, seconds=6.0, offset_s=0.013, rate_hz=200):
    """Integrates I q'' = kp (u - q) - kv v - d v + torque by Heun's rule at 0.1 ms, in NumPy.

    Commands come every 50 ms, the first one `offset_s` after the first measurement.
    """
    h, rng = 1e-4, np.random.default_rng(0)
    commands = 0.4 * np.sin(2.0 * np.arange(0.0, seconds, 0.05))

    def acceleration(t, q, v):
        index = int(np.floor((t - offset_s) / 0.05 + 1e-9))
        u = commands[min(index, len(commands) - 1)] if index >= 0 else 0.0
        return (KP * (u - q) - (KV + DAMPING) * v + torque(t, q, v)) / INERTIA

    q = v = 0.0
    positions, every = [], round(1 / rate_hz / h)
    for step in range(round(seconds / h)):
        if step % every == 0:
            positions.append(q)
        t = step * h
        a1 = acceleration(t, q, v)
        a2 = acceleration(t + h * 0.999, q + h * v, v + h * a1)
        q, v = q + h * v + 0.5 * h * h * a1, v + 0.5 * h * (a1 + a2)
    position = np.array(positions)[:, None]
    return Trajectory(
        name="hinge",
        joint_names=("a",),
        stamp_ns=np.arange(len(position)) * round(1e9 / rate_hz),
        position=position + noise * rng.normal(size=position.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=np.arange(len(commands)) * 50_000_000 + round(offset_s * 1e9),
        command=commands[:, None],
    )


@pytest.fixture(scope="module")
def ideal():
    return record()


@pytest.fixture(scope="module")
def pushed():
    return record(lambda t, _q, _v: 0.8 * np.sin(3.0 * t))


def test_smoothing_takes_noise_away_and_leaves_the_motion():
    time_s = np.arange(0.0, 10.0, 0.01)
    motion = np.stack([np.sin(time_s), 0.3 * np.cos(7.0 * time_s)], axis=1)
    noise = np.random.default_rng(0).normal(scale=1e-3, size=motion.shape)
    spline = smoothing_spline(time_s, motion + noise)
    error = spline(time_s) - motion
    assert error.std(axis=0).max() < 0.5e-3
    velocity = np.stack([np.cos(time_s), -2.1 * np.sin(7.0 * time_s)], axis=1)
    assert (spline(time_s, nu=1) - velocity)[50:-50].std(axis=0).max() < 0.02


def test_smoothing_leaves_a_clean_motion_as_it_is():
    time_s = np.arange(0.0, 5.0, 0.01)
    motion = np.sin(3.0 * time_s)[:, None]
    np.testing.assert_allclose(smoothing_spline(time_s, motion)(time_s), motion, atol=1e-4)


def test_a_replay_begins_with_the_first_command_and_holds_each_from_its_stamp(ideal):
    replay = make_replay(hybrid(), ideal)
    assert replay.start_s == pytest.approx(0.013)
    assert replay.periods == 119
    np.testing.assert_array_equal(replay.command[:, :, 0], np.repeat(ideal.command[:120], 25, 1))


def test_a_late_command_takes_effect_within_its_period(ideal):
    stamps = ideal.command_stamp_ns.copy()
    stamps[3] += 10_000_000
    command = make_replay(hybrid(), replace(ideal, command_stamp_ns=stamps)).command
    np.testing.assert_array_equal(command[3, :5, 0], ideal.command[2, 0])
    np.testing.assert_array_equal(command[3, 5:, 0], ideal.command[3, 0])


def test_the_nominal_model_predicts_its_own_recording(ideal):
    (prediction,) = rollouts(hybrid(), [ideal])
    measured = ideal.position[prediction.first :]
    assert prediction.position.shape == measured.shape
    np.testing.assert_allclose(prediction.position, measured, atol=2e-4)
    np.testing.assert_allclose(prediction.position[400:], measured[400:], atol=2e-6)
    assert not prediction.diverged
    assert not prediction.force.any()


def test_recordings_of_different_length_are_predicted_together_as_alone(ideal):
    short = record(seconds=2.0)
    together = rollouts(hybrid(), [ideal, short])
    alone = rollouts(hybrid(), [short])[0]
    np.testing.assert_array_equal(together[1].position, alone.position)
    assert len(together[0].position) > len(together[1].position)


@pytest.mark.parametrize("integrator", TOLERANCES)
def test_inverse_dynamics_recovers_the_hidden_torque(pushed, integrator):
    """Within 2.5 % of its amplitude (RK4), once the ends are left out."""
    force = residual_forces(hybrid(integrator), pushed)[:, 0]
    start = 0.013 + 0.05 * np.arange(len(force))
    truth = 0.8 * (np.cos(3.0 * start) - np.cos(3.0 * (start + 0.05))) / (3.0 * 0.05)
    assert np.abs(force - truth)[4:-4].max() < TOLERANCES[integrator]


def test_inverse_dynamics_recovers_the_hidden_torque_from_noisy_positions():
    """1e-4 rad of noise at 200 Hz leave 0.1 N m root mean square."""
    noisy = record(lambda t, _q, _v: 0.8 * np.sin(3.0 * t), noise=1e-4)
    force = residual_forces(hybrid(), noisy)[:, 0]
    truth = 0.8 * np.sin(3.0 * (0.038 + 0.05 * np.arange(len(force))))
    assert (force - truth)[4:-4].std() < 0.1


def test_residual_forces_as_a_policy_close_the_gap(pushed):
    model = hybrid()
    force = residual_forces(model, pushed)
    replay = make_replay(model, pushed)
    features = make_features(model.layout, [replay])
    periods = iter(np.concatenate([force, force[-1:]]))
    (hybrid_run,) = rollouts(
        model,
        [pushed],
        policy=lambda _o: (next(periods) / model.force_limit)[None].astype(np.float32),
        features=features,
    )
    (nominal,) = rollouts(model, [pushed])
    measured = pushed.position[nominal.first :]
    before = np.sqrt(((nominal.position - measured) ** 2).mean())
    after = np.sqrt(((hybrid_run.position - measured) ** 2).mean())
    assert before > 0.01
    assert after < 0.05 * before


def test_a_policy_sees_scaled_states_newest_first_and_the_drive_torque(pushed):
    model = hybrid()
    features = make_features(model.layout, [make_replay(model, pushed)], history=2)
    seen = []

    def watch(observation):
        seen.append(observation[0].copy())
        return np.zeros((1, 1), np.float32)

    (prediction,) = rollouts(model, [pushed], policy=watch, features=features)
    assert seen[0].shape == (features.size,) == (3 * 2 + 1,)
    np.testing.assert_array_equal(seen[0][:2], seen[0][2:4])
    np.testing.assert_array_equal(seen[7][2:6], seen[6][:4])
    q = seen[0][0] * features.scale[0] + features.mean[0]
    v = seen[0][1] * features.scale[1] + features.mean[1]
    torque = KP * (pushed.command[0, 0] - q) - KV * v
    assert seen[0][6] * features.torque_scale[0] == pytest.approx(torque, abs=1e-4)
    assert len(seen) == len(prediction.force)


@pytest.mark.parametrize("gear", [1.0, 3.0])
def test_drive_torque_is_what_mujoco_computes(gear):
    model = hinge(gear=gear)
    layout = HybridModel(models={CommandKind.POSITION: model}).layout
    data = mujoco.MjData(model)
    for q, v, u in np.random.default_rng(0).normal(size=(20, 3)):
        data.qpos[0], data.qvel[0], data.ctrl[0] = q, v, u
        mujoco.mj_forward(model, data)
        torque = drive_torque(drive_law(model, layout), *(np.array([x]) for x in (u, q, v)))
        np.testing.assert_allclose(torque, data.qfrc_actuator, rtol=1e-12)


def test_other_joints_than_the_models_are_refused(ideal):
    with pytest.raises(RecordingError, match="hinge: joints b; expected the model's, a among them"):
        make_replay(hybrid(), replace(ideal, joint_names=("b",)))


def test_a_recording_shorter_than_a_control_period_is_refused(ideal):
    short = replace(ideal, stamp_ns=ideal.stamp_ns[:8], position=ideal.position[:8])
    with pytest.raises(RecordingError, match=r"at least one control period of 0.05 s"):
        make_replay(hybrid(), short)


FALLING = """
<mujoco><option timestep="0.002"/><worldbody>
  <body><joint name="a"/><geom size="0.01" contype="0"/></body>
  <body name="object"><freejoint/><geom size="0.05 0.03 0.02" type="box" contype="0"/></body>
</worldbody><actuator><position name="a" joint="a" kp="1" kv="0.1"/></actuator></mujoco>
"""


def _tumbling():
    """A freely falling, spinning box: v0, g and a constant rate about its own z axis."""
    time_s = np.arange(0.0, 1.0, 0.01)
    rate = np.array([0.0, 0.0, 3.0])
    angle = 0.5 * rate[2] * time_s
    quaternion = np.stack([np.cos(angle), 0 * angle, 0 * angle, np.sin(angle)], axis=1)
    quaternion[40:] *= -1.0  # trackers may flip it
    position = np.array([0.1, 0.2, 5.0]) + np.outer(time_s, [0.3, 0.0, 1.0])
    position[:, 2] -= 0.5 * 9.81 * time_s**2
    stamps = (time_s * 1e9).astype(np.int64)
    return Trajectory(
        name="falling",
        joint_names=("a",),
        stamp_ns=stamps,
        position=np.zeros((len(stamps), 1)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamps[:1],
        command=np.zeros((1, 1)),
        object_track=ObjectTrack(stamp_ns=stamps, position=position, quaternion=quaternion),
    )


def test_an_object_in_free_flight_is_predicted_and_needs_no_force():
    model = HybridModel(
        models={CommandKind.POSITION: mujoco.MjModel.from_xml_string(FALLING)},
    )
    falling = _tumbling()
    (prediction,) = rollouts(model, [falling])
    position, quaternion = prediction.object_pose[:, :3], prediction.object_pose[:, 3:]
    np.testing.assert_allclose(position, falling.object_track.position, atol=0.02)
    alignment = np.abs((quaternion * falling.object_track.quaternion).sum(axis=1))
    np.testing.assert_allclose(alignment, 1.0, atol=3e-4)
    force = residual_forces(model, falling)
    assert force.shape == (19, 7)
    weight = 9.81 * model.any_model.body("object").mass[0]
    assert np.abs(force[4:-4]).max() < 0.02 * weight


def test_a_model_with_an_object_needs_its_poses():
    model = HybridModel(
        models={CommandKind.POSITION: mujoco.MjModel.from_xml_string(FALLING)},
    )
    with pytest.raises(RecordingError, match="falling: 0 object poses"):
        make_replay(model, replace(_tumbling(), object_track=None))
