"""The comparison of models, and what is kept of a fit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import BadInputError, CommandKind, ConfigError, Trajectory, Weights
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.effects import EffectInstance, find_effect
from gfm.experiments.fit import COLD, WARM, Beginning, FittedForces, Snapshot
from gfm.experiments.fit_curves import error_curves, learning_curves, metric_rows
from gfm.experiments.joint_control import (
    ForceModel,
    JointControlTest,
    from_first_command,
    make_test,
    setpoints,
)
from gfm.experiments.sealed import unseal
from gfm.report import CurveGroup, ModelKind
from gfm.sim.features import Features
from gfm.sim.hybrid import ForceLimits, HybridModel

PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="RK4"/>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" damping="0.3" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><position name="a" joint="a" kp="20" kv="1"/></actuator>
</mujoco>
"""
OFFSET_NM, NOISE_RAD = 0.8, 1e-4


def recording(seed: int, *, offset_nm: float = OFFSET_NM) -> Trajectory:
    """Returns 4 s of a pendulum with a constant torque that its model does not have."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(step=0.0005))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    ticks = np.arange(400)
    command = 0.4 * np.sin(2 * np.pi * 0.5 * 0.01 * ticks[:, None] + rng.uniform(0, 6))
    data.qpos[:] = command[0]
    data.qfrc_applied[:] = offset_nm
    position = []
    for setpoint in command:
        position.append(data.qpos.copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=20)
    return Trajectory(
        name=f"pendulum_{seed}",
        joint_names=("a",),
        stamp_ns=ticks * 10_000_000,
        position=np.array(position) + rng.normal(0.0, NOISE_RAD, (400, 1)),
        velocity=None,
        effort=np.zeros((400, 1)),
        command_kind=CommandKind.POSITION,
        command_stamp_ns=ticks * 10_000_000,
        command=command,
    )


def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(PENDULUM.format(step=0.002))


@pytest.fixture(scope="module")
def two_recordings() -> JointControlTest:
    recordings = [recording(0), recording(1)]
    return make_test({CommandKind.POSITION: spec()}, recordings, measure_noise(recordings))


def hybrid(limit_nm: float = 2.0) -> HybridModel:
    return HybridModel(
        models={CommandKind.POSITION: spec().compile()},
        joint_names=("a",),
        limits=ForceLimits(joint_nm=limit_nm),
    )


def constant_force(share: float, model: HybridModel) -> ForceModel:
    features = Features(history=0, mean=np.zeros(2), scale=np.ones(2), torque_scale=np.ones(1))

    def policy(observation: np.ndarray) -> np.ndarray:
        return np.full((len(observation), 1), share, np.float32)

    return ForceModel(model=model, features=features, policy=policy)


def offset() -> Sequence[EffectInstance]:
    effect = find_effect("torque_offset")
    return [EffectInstance(effect=effect, joints=("a",), values={"torque": OFFSET_NM})]


def test_a_hybrid_model_without_forces_errs_as_the_nominal_one(two_recordings):
    nominal = two_recordings.model_errors(ModelKind.NOMINAL, (), "")
    without = two_recordings.hybrid_errors(ModelKind.HYBRID, None, hybrid(), "")
    assert nominal.overall > 100 * NOISE_RAD
    assert without.overall == pytest.approx(nominal.overall, rel=1e-3)


def test_a_hybrid_model_with_the_missing_force_errs_as_the_corrected_one(two_recordings):
    model = hybrid()
    corrected = two_recordings.model_errors(ModelKind.CORRECTED, offset(), "")
    forces = constant_force(OFFSET_NM / 2.0, model)
    learned = two_recordings.hybrid_errors(ModelKind.HYBRID, forces, model, "")
    assert corrected.overall == pytest.approx(NOISE_RAD, rel=0.1)
    assert learned.overall == pytest.approx(corrected.overall, rel=0.1)


def test_errors_of_a_model_that_is_right_are_the_noise_floor(two_recordings):
    table = two_recordings.comparison(
        [two_recordings.model_errors(ModelKind.CORRECTED, offset(), "")]
    )
    assert table.models[0].overall == pytest.approx(table.noise_floor, rel=0.15)
    assert table.joint_noise_floors == pytest.approx((NOISE_RAD,), rel=0.15)


def test_predictions_are_measurements_less_errors(two_recordings):
    errors = two_recordings.model_errors(ModelKind.NOMINAL, (), "")
    shown = two_recordings.held_out_rollouts([errors])[1]
    assert shown.recording == "pendulum_1"
    np.testing.assert_allclose(
        shown.measured - shown.predicted[ModelKind.NOMINAL], errors.errors[1]
    )


def test_setpoints_hold_until_the_next_command():
    sparse = replace(
        recording(0),
        command_stamp_ns=np.array([0, 1_000_000_000]),
        command=np.array([[1.0], [2.0]]),
    )
    held = setpoints(sparse)
    assert held is not None
    assert held[0] == held[99] == 1.0
    assert held[100] == held[-1] == 2.0


def test_velocity_commands_are_no_setpoints():
    assert setpoints(replace(recording(0), command_kind=CommandKind.VELOCITY)) is None


def test_what_was_measured_before_the_first_command_is_left_out():
    late = replace(recording(0), command_stamp_ns=recording(0).command_stamp_ns + 55_000_000)
    started = from_first_command(late)
    assert started.stamp_ns[0] == 60_000_000
    assert started.effort is not None
    assert len(started.effort) == len(started.position) == 394


def test_recordings_of_torques_are_refused():
    torques = replace(recording(0), command_kind=CommandKind.EFFORT)
    motor = '<motor name="a" joint="a"/>'
    text = PENDULUM.replace('<position name="a" joint="a" kp="20" kv="1"/>', motor)
    specs = {CommandKind.EFFORT: mujoco.MjSpec.from_string(text.format(step=0.002))}
    with pytest.raises(ConfigError, match="effort commands: expected position or velocity"):
        make_test(specs, [torques], measure_noise([torques]))


def snapshot(version: int, error: float) -> Snapshot:
    tensors = {name: np.ones(2, np.float32) for name in ("mean.weight", "mean.bias", "first.bias")}
    weights = Weights(version=version, created_ns=0, spec_digest="", tensors=tensors)
    return Snapshot(weights=weights, time_s=float(version), error=error)


def fitted(
    *snapshots: Snapshot, lacking: bool = True, foretells: bool = True, began: Beginning = WARM
) -> FittedForces:
    # What is kept does not depend on the problem.
    return FittedForces(
        problem=None,  # type: ignore[arg-type]
        about="forces on a",
        began=began,
        unit="rad",
        nominal_error=0.5,
        lacking=lacking,
        foretells=foretells,
        snapshots=snapshots,
        curves=(),
    )


def test_the_policy_with_the_smallest_training_error_is_kept():
    outcome = fitted(snapshot(0, 0.2), snapshot(1600, 0.1), snapshot(1700, 0.3))
    assert outcome.best.weights.version == 1600
    assert outcome.detail == (
        "warm start (missing forces, regressed) refined by 1600 learner steps; training error "
        "0.5 rad without forces, 0.2 at first, 0.1 after learning; forces on a"
    )


def test_a_policy_that_had_learned_nothing_is_called_so():
    """Its critic learns alone for fewer steps than that of a warm start."""
    outcome = fitted(snapshot(0, 0.5), snapshot(1200, 0.4), began=COLD)
    assert outcome.detail == (
        "policy that had learned nothing refined by 1200 learner steps; training error "
        "0.5 rad without forces, 0.5 at first, 0.4 after learning; forces on a"
    )


def test_the_warm_start_is_kept_where_learning_does_not_improve_it():
    outcome = fitted(snapshot(0, 0.2), snapshot(1600, 0.25), snapshot(1700, 0.3))
    assert outcome.best.weights.version == 0
    assert outcome.detail == (
        "warm start (missing forces, regressed) kept: reinforcement learning did not improve it; "
        "training error 0.5 rad without forces, 0.2 at first, 0.25 at best after learning; "
        "forces on a"
    )


def test_no_force_is_kept_where_none_does_any_good():
    outcome = fitted(snapshot(0, 0.6), snapshot(1600, 0.55))
    assert outcome.kept.version == 1600
    assert (outcome.kept.tensors["mean.weight"] == 0.0).all()
    assert (outcome.kept.tensors["mean.bias"] == 0.0).all()
    assert (outcome.kept.tensors["first.bias"] == 1.0).all()
    assert outcome.detail == (
        "no force kept: none did any good; training error 0.5 rad without forces, 0.6 at first; "
        "forces on a"
    )


def test_no_force_is_kept_where_only_noise_is_left():
    outcome = fitted(snapshot(0, 0.1), lacking=False)
    assert (outcome.kept.tensors["mean.weight"] == 0.0).all()
    assert outcome.detail == (
        "no force kept: nothing but noise is left on any joint (0.5 rad in training recordings)"
    )


def test_a_first_policy_that_foretells_nothing_is_not_kept():
    outcome = fitted(snapshot(0, 0.2), foretells=False)
    assert (outcome.kept.tensors["mean.weight"] == 0.0).all()
    assert outcome.detail.startswith("no force kept: none did any good")
    assert fitted(snapshot(0, 0.2), snapshot(1600, 0.1), foretells=False).helps


def test_a_fit_without_learning_says_so():
    assert fitted(snapshot(0, 0.2)).detail.startswith("warm start (missing forces, regressed);")


def metric_row(step: int, time_s: float) -> dict[str, float]:
    names = ("reward_mean", "critic_loss", "policy_loss", "kl_mean_relative", "kl_stddev_relative")
    return {"learner_step": step, "time_s": time_s, **dict.fromkeys(names, 0.5 * step)}


def test_learning_curves_count_from_the_start_of_learning(tmp_path):
    rows = [metric_row(20, 1000.5), metric_row(40, 1001.5)]
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (tmp_path / "metrics.jsonl").write_text(text + '{"learner_step": 60, "ti')
    curves = learning_curves(metric_rows(tmp_path), 1000.0)
    assert {curve.group for curve in curves} == {
        CurveGroup.REWARD,
        CurveGroup.LOSS,
        CurveGroup.KL,
    }
    np.testing.assert_allclose(curves[0].wall_clock_s, (0.5, 1.5))
    np.testing.assert_allclose(curves[0].learner_steps, (20, 40))
    np.testing.assert_allclose(curves[0].value, (10.0, 20.0))


def test_without_metrics_there_are_no_learning_curves(tmp_path):
    assert learning_curves(metric_rows(tmp_path), 0.0) == ()


def test_error_curves_show_both_with_and_without_forces():
    learned, without = error_curves([(0.0, 0, 0.2), (15.0, 300, 0.1)], 0.4, "rad")
    np.testing.assert_allclose(learned.value, (0.2, 0.1))
    np.testing.assert_allclose(learned.learner_steps, (0, 300))
    np.testing.assert_allclose(without.value, (0.4, 0.4))


def sealed(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_the_sealed_file_tells_what_was_hidden(tmp_path):
    from gfm_robot_bridge.simulated.hidden import draw
    from gfm_robot_bridge.simulated.sealed import seal

    effects = draw("stribeck_friction", 3, np.zeros(7))
    seal(tmp_path / "sealed.json", effects, choice="stribeck_friction", seed=3)
    opened = unseal(tmp_path / "sealed.json")
    assert [one.effect for one in opened] == ["stribeck_friction", "coulomb_friction"]
    assert opened[0].joints == (f"right_j{effects[0].joints[0]}",)
    speed = opened[0].parameters["stribeck_velocity"]
    assert (speed.value, speed.unit) == (effects[0].parameters["stribeck_velocity"], "rad/s")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not a sealed file"),
        ("[]", "not a sealed file"),
        ('{"schema": "gfm.sealed/1"}', "not a sealed file"),
        ('{"schema": "gfm.sealed/2", "effects": []}', "schema 'gfm.sealed/2', expected"),
        (
            '{"schema": "gfm.sealed/1", "effects": '
            '[{"effect": "a", "joints": "b", "parameters": {}}]}',
            "joints or parameters of the wrong type",
        ),
    ],
)
def test_another_file_is_no_sealed_file(tmp_path, text, message):
    with pytest.raises(BadInputError, match=message):
        unseal(sealed(tmp_path / "sealed.json", text))


def test_a_missing_sealed_file_is_said():
    with pytest.raises(BadInputError, match=r"absent\.json: cannot be read"):
        unseal(Path("absent.json"))


def test_what_was_seen_while_only_the_critic_learned_does_not_count_as_learned():
    outcome = fitted(snapshot(0, 0.2), snapshot(WARM.critic_first_steps, 0.2))
    assert outcome.detail.startswith("warm start (missing forces, regressed);")
