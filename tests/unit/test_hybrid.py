"""Batched hybrid stepping is MuJoCo's own stepping, with bounded forces."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, UnknownNameError
from gfm.sim.batch import HybridBatch
from gfm.sim.hybrid import ForceLimits, HybridModel
from gfm.sim.layout import make_layout
from gfm.sim.sawyer import JOINT_NAMES, NEUTRAL, READY, sawyer_spec

IDS = np.arange(3)


def sawyer(**kwargs):
    models = {kind: sawyer_spec(command=kind, **kwargs).compile() for kind in CommandKind}
    return HybridModel(models=models)


@pytest.fixture(scope="module")
def arm():
    return sawyer()


@pytest.fixture(scope="module")
def cell():
    return sawyer(end_effector="plate", free_object="brick")


def start(model, kind=CommandKind.POSITION, pose=READY, nthread=1):
    batch = HybridBatch(model, len(IDS), nthread=nthread)
    qpos = np.tile(model.models[kind].qpos0, (len(IDS), 1))
    qpos[:, :7] = pose
    batch.reset(
        IDS, [model.models[kind]] * len(IDS), qpos, np.zeros((len(IDS), model.any_model.nv))
    )
    return batch


def plain_loop(model, qpos, commands, forces):
    """One MjData, stepped as the manual says."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    states = []
    for command, force in zip(commands, forces, strict=True):
        data.qfrc_applied[:] = force
        for ctrl in np.broadcast_to(command, (25, 7)):
            data.ctrl[:] = ctrl
            mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


@pytest.mark.parametrize("per_step", [False, True])
@pytest.mark.parametrize("fixture", ["arm", "cell"])
def test_batch_equals_a_plain_loop_bit_for_bit(fixture, per_step, request):
    model = request.getfixturevalue(fixture)
    nv = model.any_model.nv
    rng = np.random.default_rng(0)
    batch = start(model, nthread=2)
    qpos = batch.qpos.copy()
    shape = (6, 3, 25, 7) if per_step else (6, 3, 7)
    commands = READY + 0.1 * rng.normal(size=shape)
    forces = rng.uniform(-1.0, 1.0, size=(6, 3, nv)) * model.force_limit
    states = []
    for command, force in zip(commands, forces, strict=True):
        assert not batch.step(command, force).any()
        states.append(np.concatenate([batch.qpos, batch.qvel], axis=1))
    for i in IDS:
        expected = plain_loop(
            model.models[CommandKind.POSITION], qpos[i], commands[:, i], forces[:, i]
        )
        np.testing.assert_array_equal(np.array(states)[:, i], expected)


def test_instances_may_take_different_kinds_of_command(arm):
    batch = HybridBatch(arm, 3)
    kinds = list(CommandKind)
    batch.reset(IDS, [arm.models[k] for k in kinds], np.tile(NEUTRAL, (3, 1)), np.zeros((3, 7)))
    commands = np.stack([NEUTRAL + 0.1, np.full(7, 0.1), np.full(7, 1.0)])
    batch.step(commands, np.zeros((3, 7)))
    for i, kind in enumerate(kinds):
        expected = plain_loop(arm.models[kind], NEUTRAL, commands[None, i], np.zeros((1, 7)))
        np.testing.assert_array_equal(batch.qpos[i], expected[0, :7])


def test_forces_never_exceed_their_limits(cell):
    huge, limit = start(cell), start(cell)
    command = np.tile(READY, (3, 1))
    for _ in range(3):
        huge.step(command, np.full((3, 13), 1e9))
        limit.step(command, np.tile(cell.force_limit, (3, 1)))
    np.testing.assert_array_equal(huge.qpos, limit.qpos)


def test_limits_are_the_papers(cell):
    np.testing.assert_array_equal(cell.force_limit, [5.0] * 7 + [0.03] * 6)


def test_a_constant_torque_deflects_a_position_servo_by_torque_over_stiffness(arm):
    batch = start(arm, pose=NEUTRAL)
    force = np.zeros((3, 7))
    force[:, 2] = 4.0
    for _ in range(60):
        batch.step(np.tile(NEUTRAL, (3, 1)), force)
    assert batch.qpos[0, 2] - NEUTRAL[2] == pytest.approx(4.0 / 800.0, rel=1e-3)


def test_an_object_force_moves_the_object_only(cell):
    pushed, left = start(cell), start(cell)
    for data, newton in ((pushed, 0.03), (left, 0.0)):
        data.qpos[:, cell.layout.object_qpos.start + 2] += 5.0  # in free fall
        force = np.zeros((3, 13))
        force[:, 7] = newton
        data.step(np.tile(READY, (3, 1)), force)
    x = cell.layout.object_dof.start
    assert pushed.qvel[0, x] - left.qvel[0, x] == pytest.approx(0.03 / 0.15 * 0.05, rel=1e-6)
    np.testing.assert_array_equal(pushed.qpos[:, :7], left.qpos[:, :7])


@pytest.mark.parametrize("per_step", [False, True])
def test_divergence_is_reported_for_its_instance_only_and_undone(
    arm, per_step, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    batch = start(arm)
    command = np.tile(READY, (3, 25, 1)) if per_step else np.tile(READY, (3, 1))
    batch.step(command, np.zeros((3, 7)))
    batch.qvel[1, 0] = 1e12
    before = batch.qpos[1].copy()
    np.testing.assert_array_equal(batch.step(command, np.zeros((3, 7))), [False, True, False])
    np.testing.assert_array_equal(batch.qpos[1], before)
    assert not list(tmp_path.iterdir()), "MuJoCo wrote a log file"


def test_models_of_different_layout_are_refused(arm, cell):
    with pytest.raises(ConfigError, match=r"the velocity model has .*'nq': 14"):
        HybridModel(
            models={
                CommandKind.POSITION: arm.any_model,
                CommandKind.VELOCITY: cell.models[CommandKind.VELOCITY],
            }
        )


def test_a_control_period_that_is_no_multiple_of_the_time_step_is_refused(arm):
    with pytest.raises(ConfigError, match=r"0.0513.*time step 0.002"):
        HybridModel(models=arm.models, control_period_s=0.0513)


def test_limits_must_be_positive():
    with pytest.raises(ConfigError, match="joint_nm is 0"):
        ForceLimits(joint_nm=0.0)


def test_unknown_joint_is_refused_with_the_known_ones(arm):
    with pytest.raises(UnknownNameError, match="unknown joint 'elbow'; available: right_j0"):
        make_layout(arm.any_model, ("elbow",))


def with_gain(arm, factor):
    nominal = arm.models[CommandKind.POSITION]
    recording = SimpleNamespace(
        command_kind=CommandKind.POSITION, servo_gain={"right_j2": factor}, name="run"
    )
    return nominal, arm.model_for(recording)


def test_servo_gain_scales_the_stiffness_of_a_copy(arm):
    nominal, soft = with_gain(arm, 0.5)
    assert soft.actuator("right_j2").gainprm[0] == 400.0
    np.testing.assert_array_equal(soft.actuator("right_j2").biasprm[:3], [0.0, -400.0, -80.0])
    assert nominal.actuator("right_j2").gainprm[0] == 800.0
    assert with_gain(arm, 1.0)[1] is nominal


def test_a_servo_without_gain_is_switched_off_and_does_not_damp(arm):
    _, off = with_gain(arm, 0.0)
    assert off.actuator("right_j2").gainprm[0] == 0.0
    np.testing.assert_array_equal(off.actuator("right_j2").biasprm[:3], 0.0)
    assert off.actuator("right_j1").biasprm[2] < 0.0


MOTOR_SIDE = """
<mujoco><worldbody>
  <body name="link"><joint name="a"/><geom size="0.1" pos="0.1 0 0"/></body>
  <body name="a_motor"><joint name="a_motor" armature="0.1"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>
</worldbody><actuator><position name="a" joint="a_motor" kp="10"/></actuator></mujoco>
"""


def test_a_motor_side_starts_where_its_joint_starts():
    layout = make_layout(mujoco.MjModel.from_xml_string(MOTOR_SIDE))
    assert layout.joint_names == ("a",)
    np.testing.assert_array_equal(layout.as_qpos(np.array([0.3])), [0.3, 0.3])
    np.testing.assert_array_equal(layout.as_qvel(2, np.array([0.5])), [0.5, 0.5])


DELAYED = """
<mujoco><option timestep="0.01"/><worldbody><body><joint name="a"/><geom size="0.1"/></body>
</worldbody><actuator><motor name="a" joint="a" delay="0.03" nsample="5"/></actuator></mujoco>
"""


def test_delayed_commands_start_with_the_one_that_was_in_force():
    delayed = mujoco.MjModel.from_xml_string(DELAYED)
    model = HybridModel(models={CommandKind.EFFORT: delayed}, control_period_s=0.03)
    batch = HybridBatch(model, 1)
    batch.reset(np.array([0]), [delayed], np.zeros((1, 1)), np.zeros((1, 1)), np.array([[2.0]]))
    batch.step(np.array([[-5.0]]), np.zeros((1, 1)))
    data = mujoco.MjData(delayed)
    mujoco.mj_forward(delayed, data)
    inertia = float(data.M[0])
    assert batch.qvel[0, 0] == pytest.approx(2.0 * 0.03 / inertia, rel=1e-9)


FILTERED = """
<mujoco><option timestep="0.01"/><worldbody><body><joint name="a"/><geom size="0.1"/></body>
</worldbody><actuator><general name="a" joint="a" dyntype="filterexact" dynprm="0.5"/></actuator>
</mujoco>"""


def test_filtered_commands_start_settled_at_the_one_that_was_in_force():
    filtered = mujoco.MjModel.from_xml_string(FILTERED)
    model = HybridModel(models={CommandKind.EFFORT: filtered})
    batch = HybridBatch(model, 1)
    held = np.array([[2.0]])
    batch.reset(np.array([0]), [filtered], np.zeros((1, 1)), np.zeros((1, 1)), held)
    batch.step(held, np.zeros((1, 1)))
    data = mujoco.MjData(filtered)
    mujoco.mj_forward(filtered, data)
    assert batch.qvel[0, 0] == pytest.approx(2.0 * 0.05 / float(data.M[0]), rel=1e-9)


def test_what_is_recorded_is_every_integration_step_and_nothing_after_a_divergence(arm):
    batch, plain = start(arm), start(arm)
    command = np.tile(READY + 0.1, (3, 25, 1))
    batch.qvel[1, 0] = 1e12
    before = batch.qpos[1].copy()
    diverged, qpos, qvel = batch.step_recorded(command, np.zeros((3, 7)))
    plain.step(command, np.zeros((3, 7)))
    np.testing.assert_array_equal(diverged, [False, True, False])
    assert qpos.shape == qvel.shape == (3, 25, 7)
    np.testing.assert_array_equal(qpos[0, -1], plain.qpos[0])
    np.testing.assert_array_equal(qpos[1], np.tile(before, (25, 1)))


def test_joints_of_the_sawyer_are_found_without_being_named(cell):
    assert cell.layout.joint_names == JOINT_NAMES
    np.testing.assert_array_equal(cell.force_dof, np.arange(13))
