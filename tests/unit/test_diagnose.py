"""From recordings to a verdict, on a pendulum that SciPy integrates: nothing of it is MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, Trajectory, UnknownNameError
from gfm.diagnosis.data.segmentation import all_segments, in_model_order, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict
from gfm.effects import EffectInstance, effect_library
from gfm.signals.smoothing import smooth_states
from gfm.sim.commands import AFTER, BEFORE
from pendulum import DAMPING, MODEL, PERIOD_S, STIFFNESS, swung

NOISE = 3e-4


def command(time_s, seed):
    rng = np.random.default_rng(seed)
    speeds, phases = rng.uniform(1.0, 5.0, 3), rng.uniform(0.0, 6.0, 3)
    waves = np.sin(np.outer(time_s, speeds) + phases).sum(axis=1)
    return 0.25 * np.minimum(time_s, 1.0) * waves


def recording(seed, torque=lambda _q, _v: 0.0, duration=4.0, **truth):
    stamps = np.arange(0.0, duration, PERIOD_S)
    return swung(command(stamps, seed), seed=seed, noise=NOISE, torque=torque, **truth)


def verdict_on(**truth):
    runs = [recording(seed, **truth) for seed in range(3)]
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    return diagnose(specs, runs[:2], runs[2:])


def side_by_side(seed, first, second):
    """Two pendulums that know nothing of each other, recorded as one robot."""
    one, other = recording(seed, first), recording(seed + 50, second)
    return replace(
        one,
        joint_names=("a", "b"),
        position=np.hstack([one.position, other.position]),
        command=np.hstack([one.command, other.command]),
    )


def two_pendulums():
    spec = mujoco.MjSpec.from_string(MODEL.replace('"j"', '"a"'))
    beside = mujoco.MjSpec.from_string(MODEL.replace('"j"', '"b"'))
    spec.attach(beside, prefix="", frame=spec.worldbody.add_frame(pos=[0.0, 1.0, 0.0]))
    return {CommandKind.POSITION: spec}


def told_of_two(first, second):
    """What is found on two pendulums."""
    runs = [side_by_side(seed, first, second) for seed in range(3)]
    runs[1] = runs[1].with_joints(("b", "a"))
    found = diagnose(two_pendulums(), runs[:2], runs[2:])
    return {(e.effect, e.joints): e.parameters["torque"].value for e in found.effects}


def test_what_two_joints_lack_is_found_on_both():
    assert told_of_two(lambda _q, _v: 0.3, lambda _q, _v: -0.2) == {
        ("torque_offset", ("a",)): pytest.approx(0.3, rel=0.05),
        ("torque_offset", ("b",)): pytest.approx(-0.2, rel=0.05),
    }


def test_what_one_joint_lacks_is_not_blamed_on_its_sister():
    amounts = told_of_two(lambda _q, _v: 0.3, lambda _q, _v: 0.0)
    assert list(amounts) == [("torque_offset", ("a",))]


def test_joints_are_in_the_order_of_the_model_however_they_were_recorded():
    run = side_by_side(0, lambda _q, _v: 0.0, lambda _q, _v: 0.0)
    strange = replace(run, joint_names=("unknown", "a"))
    assert in_model_order(two_pendulums(), [strange])[0].joint_names == ("a", "unknown")
    (same,) = in_model_order(two_pendulums(), [run.with_joints(("b", "a"))])
    assert same.joint_names == ("a", "b")
    np.testing.assert_array_equal(same.position, run.position)
    np.testing.assert_array_equal(same.command, run.command)


def test_nothing_is_named_where_nothing_is_missing():
    said = verdict_on()
    assert said.verdict is Verdict.NO_GAP
    assert said.effects == ()
    assert said.error.before == pytest.approx(NOISE, rel=0.15)


@pytest.mark.parametrize(
    ("name", "parameter", "amount", "torque"),
    [
        ("coulomb_friction", "torque", 0.15, lambda _q, v: -0.15 * np.tanh(v / 1e-3)),
        ("viscous_friction", "coefficient", 0.3, lambda _q, v: -0.3 * v),
        ("joint_spring", "stiffness", 1.5, lambda q, _v: -1.5 * (q - 0.2)),
    ],
)
def test_a_missing_torque_is_named_with_its_amount(name, parameter, amount, torque):
    said = verdict_on(torque=torque)
    assert said.verdict is Verdict.EXPLAINED
    assert (said.effects[0].effect, said.effects[0].joints) == (name, ("j",))
    assert said.effects[0].parameters[parameter].value == pytest.approx(amount, rel=0.05)
    assert said.effects[0].confidence > 0.5
    assert said.error.after < 1.5 * said.error.noise_floor < said.error.before


def test_a_delay_is_named_and_the_corrected_model_has_it():
    said = verdict_on(delay=0.0237)
    assert said.effects[0].effect == "command_delay"
    assert said.effects[0].parameters["delay"].value == pytest.approx(0.0237, abs=5e-4)
    model = mujoco.MjModel.from_xml_string(said.corrected_xml)
    assert model.actuator_delay[0] == pytest.approx(0.0237, abs=5e-4)
    assert "command_delay on j: delay" in said.corrected_xml


def test_a_robot_that_hardly_moves_gives_insufficient_data():
    runs = [recording(seed) for seed in range(2)]
    still = [
        Trajectory(**{**vars(run), "position": 1e-3 * run.position, "command": 0 * run.command})
        for run in runs
    ]
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    said = diagnose(specs, still[:1], still[1:])
    assert said.verdict is Verdict.INSUFFICIENT_DATA
    assert "no joint moves by more than" in said.sentence


def test_commands_of_another_kind_than_the_actuators_are_refused():
    specs = {CommandKind.EFFORT: mujoco.MjSpec.from_string(MODEL)}
    run = recording(0, duration=2.0)
    with pytest.raises(ConfigError, match="run 0: its commands are of kind position"):
        diagnose(specs, [run], [run])


def test_a_model_of_another_robot_is_refused():
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL.replace('"j"', '"k"'))}
    run = recording(0, duration=2.0)
    with pytest.raises(UnknownNameError, match="unknown joint 'j'; available: k"):
        diagnose(specs, [run], [run])


@pytest.mark.parametrize("late", [0, 1])
def test_when_efforts_were_measured_is_told_under_the_effects_that_were_found(late):
    """A command at the stamp of a measurement is in force at it, or only afterwards."""
    run = recording(0, torque=lambda _q, v: -3.0 * v)
    q, v, _ = smooth_states(run.time_s, run.position)
    in_force = np.roll(run.command, late, axis=0)
    run = replace(run, effort=STIFFNESS * (in_force - q) - DAMPING * v)
    problem = prepared(
        all_segments({CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}, [run])
    )
    viscous = EffectInstance(
        effect=effect_library()["viscous_friction"], joints=("j",), values={"coefficient": 3.0}
    )
    assert problem.in_force == AFTER  # the nominal model is far off and says so in either case
    assert problem.settled([viscous]).in_force == (AFTER if late == 0 else BEFORE)
