"""What a pushed object lacks, on slides that SciPy integrates: nothing of them is MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.core import CommandKind, ConfigError, ObjectTrack, Trajectory
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.objects.examine import Contacts, examine_object
from gfm.diagnosis.objects.problem import STATE_STEPS, _unknown
from gfm.diagnosis.output.result import Verdict
from gfm.signals.object_segments import Scene, _moving, cut
from gfm.signals.object_track import plane_noise, track_of
from gfm.sim.object_stage import make_stage
from slide import MASS, MU, REST_Z, SLIDE

PERIOD_S, NOISE_M, NOISE_RAD = 1 / 60, 5e-4, 5e-3
AMISS = np.array([0.0, 0.03, 0.0])
EPOCH_NS = 1_000_000_000
FREE = SLIDE.replace('pos="-0.35 0 0.03"', 'pos="0 4 0.03"')


def spec(text=FREE):
    return mujoco.MjSpec.from_string(text)


def slides(seed, *, friction=MU, damping=0.0, count=3, fastest=1.3):
    """Returns where an object is that is flicked again and again, shape (P, 3): x, y, yaw.

    It slides straight on, braked by friction mu m g and damping times speed, until it rests.
    """
    rng, here, path = np.random.default_rng(seed), np.zeros(3), []
    time_s = np.arange(0.0, 0.7, PERIOD_S)

    def motion(_, state):
        return [state[1], -friction * 9.81 - damping / MASS * state[1]]

    def rests(_, state):
        return state[1]

    rests.terminal = True
    for _ in range(count):
        path.append(np.repeat(here[None], 24, axis=0))
        speed, way = rng.uniform(0.5, fastest), rng.uniform(0.0, 2.0 * np.pi)
        answer = solve_ivp(
            motion, (0.0, 0.7), [0.0, speed], dense_output=True, events=rests, rtol=1e-9
        )
        slid = answer.sol(np.minimum(time_s, answer.t[-1]))[0]
        path.append(here + np.outer(slid, [np.cos(way), np.sin(way), 0.0]))
        here = path[-1][-1]
    return np.concatenate(path)


def recording(seed, path):
    """Returns a recording of an object's path, and of an arm that swings as its model says."""
    rng = np.random.default_rng(seed + 100)
    time_s = PERIOD_S * np.arange(len(path))
    noise = [NOISE_M, NOISE_M, NOISE_RAD]
    x, y, yaw = (path + rng.standard_normal(path.shape) * noise).T
    z = REST_Z + NOISE_M * rng.standard_normal(len(path))
    still = np.zeros(len(path))
    ticks = np.arange(0.0, time_s[-1], 0.01)
    told = 0.3 * np.sin(3.0 * ticks)
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=EPOCH_NS + np.round(ticks * 1e9).astype(np.int64),
        position=swing(told) + 1e-4 * rng.standard_normal((len(ticks), 1)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=EPOCH_NS + np.round(ticks * 1e9).astype(np.int64),
        command=told[:, None],
        object_track=ObjectTrack(
            stamp_ns=EPOCH_NS + np.round(time_s * 1e9).astype(np.int64),
            position=np.stack([x, y, z], axis=1),
            quaternion=np.stack([np.cos(yaw / 2), still, still, np.sin(yaw / 2)], axis=1),
        ),
    )


def swing(told):
    """Returns how the arm follows its commands, alone, shape (T, 1)."""
    alone = spec()
    alone.delete(alone.body("object"))
    alone.option.timestep, alone.option.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    model = alone.compile()
    data, position = mujoco.MjData(model), []
    for command in told:
        position.append(data.qpos.copy())
        data.ctrl[:] = command
        mujoco.mj_step(model, data, nstep=10)
    return np.array(position)


def scene(run_):
    model = spec(SLIDE)
    track = track_of(run_)
    stages = {"stage": make_stage(model), "air": make_stage(model, robot_touches=False)}
    return Scene(index=0, recording=run_, track=track, noise=plane_noise([track]), **stages)


def part(*paths, text=FREE):
    runs = [recording(seed, path) for seed, path in enumerate(paths)]
    return examine_object(spec(text), runs, runs, lambda _: None)


def test_friction_is_named_with_its_amount_and_goes_into_the_corrected_model():
    runs = [recording(seed, slides(seed, friction=0.45)) for seed in range(3)]
    said = diagnose({CommandKind.POSITION: spec()}, runs[:2], runs[2:])
    assert [(e.effect, e.joints) for e in said.effects] == [("object_friction", ())]
    amount = said.effects[0].parameters["coefficient"]
    assert amount.value == pytest.approx(0.15, abs=0.01)
    assert amount.ci95[0] < 0.15 < amount.ci95[1]
    assert said.effects[0].confidence > 0.5
    assert said.verdict is Verdict.EXPLAINED
    assert said.object_error["position"].after < 2.0 * NOISE_M
    assert said.object_error["position"].before > 5.0 * NOISE_M
    assert "misses object friction" in said.sentence
    corrected = mujoco.MjModel.from_xml_string(said.corrected_xml)
    assert corrected.geom_friction[-1, 0] == pytest.approx(0.45, abs=0.01)
    assert "object_mass" in {spot.effect for spot in said.blind_spots}
    assert any(plot.title.startswith("Path of the object") for plot in said.plots)


def test_nothing_is_named_where_nothing_is_missing():
    found = part(slides(0), slides(1))
    assert found.found.fit.effects == ()
    assert found.overall.before < 1.25


def pushed(seed, offset):
    """Returns a recording of an arm that pushes an object whose mass lies `offset` aside, m.

    The truth is simulated with the steps and the integrator of no model that is tested.
    """
    true, rng = spec(SLIDE), np.random.default_rng(seed)
    true.option.timestep, true.option.integrator = 2.5e-4, mujoco.mjtIntegrator.mjINT_EULER
    box = true.body("object")
    box.explicitinertial, box.mass, box.ipos = True, MASS, [*offset, 0.0]
    box.inertia = MASS / 3 * np.array([0.04**2 + REST_Z**2, 0.05**2 + REST_Z**2, 0.05**2 + 0.04**2])
    model = true.compile()
    data = mujoco.MjData(model)
    yaw = rng.uniform(-np.pi, np.pi)
    data.qpos[:] = [0.5, rng.uniform(-0.12, -0.08), rng.uniform(-0.02, 0.02), REST_Z, 0, 0, 0, 0]
    data.qpos[4], data.qpos[7] = np.cos(yaw / 2), np.sin(yaw / 2)
    ticks, told, arm, poses = np.arange(0.0, 1.8, 0.01), [], [], []
    for now in ticks:
        told.append(0.5 - 0.7 * max(now - 0.3, 0.0))
        arm.append(data.qpos[:1].copy())
        poses.append(data.qpos[1:].copy())
        data.ctrl[:] = told[-1]
        mujoco.mj_step(model, data, nstep=40)
    begun, pose = recording(seed, np.zeros((108, 3))), np.array(poses)
    stamp_ns = EPOCH_NS + np.round(ticks * 1e9).astype(np.int64)
    turn = 0.5 * NOISE_RAD * rng.standard_normal(len(pose))
    w, x, y, z = pose[:, 3:].T
    about_z = [w - z * turn, x - y * turn, y + x * turn, z + w * turn]
    return replace(
        begun,
        stamp_ns=stamp_ns,
        position=np.array(arm) + 1e-4 * rng.standard_normal((len(arm), 1)),
        command_stamp_ns=stamp_ns,
        command=np.array(told)[:, None],
        object_track=ObjectTrack(
            stamp_ns=stamp_ns,
            position=pose[:, :3] + NOISE_M * rng.standard_normal((len(pose), 3)),
            quaternion=np.stack(about_z, axis=1),
        ),
    )


def test_pushes_from_rest_tell_where_the_mass_lies():
    runs = [pushed(seed, (0.015, -0.01)) for seed in range(4)]
    found = examine_object(spec(SLIDE), runs, runs, lambda _: None)
    segments = found.found.problem.segments
    assert all(one.place_error is not None for one in segments)
    assert max(one.time_s[-1] for one in segments) > 0.8
    assert [e.effect for e in found.named] == ["object_com"]
    amounts = found.named[0].parameters
    assert amounts["x"].value == pytest.approx(0.015, abs=0.003)
    assert amounts["y"].value == pytest.approx(-0.01, abs=0.003)


def test_nothing_is_said_of_an_object_that_is_not_where_the_model_has_it():
    """A camera that is 3 cm off, towards the arm: the arm is inside what it pushes."""
    runs = [pushed(seed, (0.015, -0.01)) for seed in range(2)]
    tracks = [replace(one.object_track, position=one.object_track.position + AMISS) for one in runs]
    runs = [replace(one, object_track=track) for one, track in zip(runs, tracks, strict=True)]
    found = examine_object(spec(SLIDE), runs, runs, lambda _: None)
    assert found.found.fit.effects == ()
    assert "inside it, by what was measured" in found.notes[0]


def test_a_mass_in_the_middle_is_not_moved():
    runs = [pushed(seed, (0.0, 0.0)) for seed in range(4)]
    assert examine_object(spec(SLIDE), runs, runs, lambda _: None).found.fit.effects == ()


def test_a_residual_is_weighed_by_what_is_unknown_of_its_beginning():
    """White noise and a beginning that varies, together: as white as noise alone."""
    rng = np.random.default_rng(0)
    segment = replace(
        cut(scene(pushed(0, (0.0, 0.0))))[0], place_error=np.array([1e-3, 2e-3, 1e-2])
    )
    columns, steps = rng.standard_normal((30, 3)), np.array(STATE_STEPS[:3])
    basis = _unknown(columns, segment)
    spread = columns * (segment.place_error / steps)
    weighed = np.eye(30) - basis @ basis.T
    assert weighed @ (np.eye(30) + spread @ spread.T) @ weighed.T == pytest.approx(np.eye(30))


def test_a_slow_push_is_seen_beside_the_noise():
    """At 30 mm/s, 30 poses a second, a millimetre off each: two of them tell nothing."""
    run_ = pushed(0, (0.0, 0.0))
    ticks = np.arange(0, 108, 2)
    path = np.stack([0.03 * PERIOD_S * ticks, 0.0 * ticks, 0.0 * ticks], axis=1)
    path[:10] = path[10]
    noisy = path + 1e-3 * np.random.default_rng(1).standard_normal(path.shape)
    still = replace(
        run_.object_track,
        stamp_ns=EPOCH_NS + np.round(ticks * PERIOD_S * 1e9).astype(np.int64),
        position=noisy * [1.0, 1.0, 0.0] + [0.0, 0.0, REST_Z],
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (len(ticks), 1)),
    )
    here = replace(scene(replace(run_, object_track=still)), noise=np.array([1e-3, 1e-3, 1e-2]))
    assert not _moving(here, here.half_window_s).any()
    assert _moving(here, here.slow_window_s)[20:-10].all()


@pytest.mark.slow
def test_what_brakes_with_the_speed_is_damping_and_no_friction():
    found = part(*(slides(seed, damping=0.4, fastest=2.5) for seed in range(2)))
    assert [e.effect.name for e in found.found.fit.effects] == ["object_damping"]
    assert found.found.fit.effects[0].values["linear"] == pytest.approx(0.4, rel=0.15)


def test_pyramidal_contacts_are_not_taken_for_friction():
    found = part(slides(0), slides(1), text=FREE.replace("elliptic", "pyramidal"))
    assert found.contacts.cone == int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    assert found.found.fit.effects == ()
    assert any("elliptic" in note for note in found.notes)


def test_contacts_are_made_harder_where_they_are_said_by_time_constants():
    nominal = spec()
    by_stiffness, *others = nominal.geoms
    by_stiffness.solref[:] = (-1000.0, -10.0)
    harder = Contacts(cone=int(mujoco.mjtCone.mjCONE_ELLIPTIC), time=0.5).applied(nominal)
    assert harder.option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    np.testing.assert_array_equal(harder.geoms[0].solref, (-1000.0, -10.0))
    for before, after in zip(others, harder.geoms[1:], strict=True):
        np.testing.assert_allclose(after.solref, before.solref * (0.5, 1.0))
    assert harder.compile().geom_solref[-1, 0] == pytest.approx(0.01)


def test_an_object_that_never_moves_is_left_alone():
    assert part(np.zeros((120, 3))) is None


def test_poses_of_an_object_that_the_model_lacks_are_refused():
    alone = spec()
    alone.delete(alone.body("object"))
    with pytest.raises(ConfigError, match="run 0: has poses of an object; the model has no body"):
        examine_object(alone, [recording(0, np.zeros((60, 3)))], [], lambda _: None)


def test_a_free_body_without_poses_is_no_question():
    run_ = replace(recording(0, np.zeros((60, 3))), object_track=None)
    assert examine_object(spec(), [run_], [], lambda _: None) is None


def test_the_yaw_is_counted_on_over_whole_turns():
    yaw = np.linspace(0.0, 15.0, 200)
    path = np.stack([0.0 * yaw, 0.0 * yaw, yaw], axis=1)
    track = track_of(recording(0, path))
    assert track.plane[-1, 2] - track.plane[0, 2] == pytest.approx(15.0, abs=0.05)
