"""From recordings to a verdict, on a pendulum that SciPy integrates: nothing of it is MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, Trajectory, UnknownNameError
from gfm.diagnosis.data.segmentation import in_model_order, make_problem
from gfm.diagnosis.data.signals import smooth_states
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.former.attribution import fit_best, with_level
from gfm.diagnosis.former.usual import usually_missing
from gfm.diagnosis.inference.fitting import fit, nothing
from gfm.diagnosis.inference.intervals import half_widths
from gfm.diagnosis.output.result import Verdict
from gfm.diagnosis.residuals.problem import settled
from gfm.diagnosis.search.candidates import joint_scales, places, torque_views
from gfm.diagnosis.search.screening import Screened, screen
from gfm.effects import EffectInstance, effect_library
from pendulum import DAMPING, MODEL, PERIOD_S, STIFFNESS, swung

NOISE = 3e-4
LIMIT = 3.0


def command(time_s, seed):
    rng = np.random.default_rng(seed)
    speeds, phases = rng.uniform(1.0, 5.0, 3), rng.uniform(0.0, 6.0, 3)
    waves = np.sin(np.outer(time_s, speeds) + phases).sum(axis=1)
    return 0.25 * np.minimum(time_s, 1.0) * waves


def recording(seed, torque=lambda _q, _v: 0.0, duration=6.0, **truth):
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
    """What is found on two pendulums, and in how many rounds."""
    runs = [side_by_side(seed, first, second) for seed in range(3)]
    runs[1] = runs[1].with_joints(("b", "a"))
    said = []
    found = diagnose(two_pendulums(), runs[:2], runs[2:], report=said.append)
    amounts = {(e.effect, e.joints): e.parameters["torque"].value for e in found.effects}
    return amounts, sum(text.startswith("screening") for text in said)


def test_what_two_joints_lack_is_found_on_both_at_once():
    amounts, rounds = told_of_two(lambda _q, _v: 0.3, lambda _q, _v: -0.2)
    assert amounts == {
        ("torque_offset", ("a",)): pytest.approx(0.3, rel=0.05),
        ("torque_offset", ("b",)): pytest.approx(-0.2, rel=0.05),
    }
    assert rounds == 1


def test_what_one_joint_lacks_is_not_blamed_on_its_sister():
    amounts, _ = told_of_two(lambda _q, _v: 0.3, lambda _q, _v: 0.0)
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


def beside_its_level(level, excess):
    """What an excess of friction that was fitted alone becomes when its level is looked for."""

    def friction(_q, v):
        return -(level + excess * np.exp(-((v / 0.08) ** 2))) * np.tanh(v / 1e-3)

    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    problem = make_problem(specs, [recording(seed, torque=friction) for seed in range(2)])
    stribeck, coulomb = (effect_library()[f"{law}_friction"] for law in ("stribeck", "coulomb"))
    starts = [
        EffectInstance(
            effect=stribeck,
            joints=("j",),
            values={"static_excess": 0.2, "stribeck_velocity": speed},
        )
        for speed in (0.06, 0.6)
    ]
    dry = EffectInstance(effect=coulomb, joints=("j",), values={"torque": 0.2})
    screened = [Screened(instance=one, gain=0.5) for one in (*starts, dry)]
    alone = fit(problem, starts[-1:] if level else starts[:1])
    found = with_level(problem, screened, alone).effects
    return {name: value for e in found for name, value in e.values.items()}


def test_an_excess_of_friction_is_told_from_the_level_above_which_it_comes():
    assert beside_its_level(0.15, 0.35) == {
        "torque": pytest.approx(0.15, rel=0.1),
        "static_excess": pytest.approx(0.35, rel=0.1),
        "stribeck_velocity": pytest.approx(0.08, rel=0.1),
    }


def test_no_level_is_made_up_for_an_excess_that_comes_alone():
    assert beside_its_level(0.0, 0.35) == {
        "static_excess": pytest.approx(0.35, rel=0.1),
        "stribeck_velocity": pytest.approx(0.08, rel=0.1),
    }


def found_together(base):
    """What is usually missing of a pendulum with delay, low gain and dry friction."""

    def friction(_q, v):
        return -0.2 * np.tanh(v / 1e-3)

    runs = [recording(seed, torque=friction, delay=0.03, gain=0.15) for seed in range(2)]
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    problem = make_problem(specs, runs)
    scales = joint_scales(problem, torque_views(problem, runs))
    found = usually_missing(problem.robust(()), base, scales)
    return {e.effect.name: next(iter(e.values.values())) for e in found.effects}


MISSING = {
    "command_delay": pytest.approx(0.03, rel=0.1),
    "actuator_gain": pytest.approx(0.15, rel=0.05),
    "coulomb_friction": pytest.approx(0.2, rel=0.05),
}


def test_what_is_usually_wrong_is_found_together_and_nothing_beside_it():
    assert found_together(()) == MISSING


def test_what_is_usually_wrong_is_found_beside_what_is_known_already():
    known = EffectInstance(
        effect=effect_library()["coulomb_friction"], joints=("j",), values={"torque": 0.05}
    )
    found = found_together((known,))
    assert next(iter(found)) == "coulomb_friction"
    assert found == MISSING


@pytest.mark.parametrize("asked", [1.5, 15.0])
def test_a_torque_limit_is_found_though_only_few_stretches_reach_it(asked):
    time_s = np.arange(0.0, 18.0, PERIOD_S)
    told = 0.2 * command(time_s, 0)
    told[(time_s > 11.0) & (time_s < 11.4)] += asked  # ten times, or a hundred times the limit
    runs = [swung(told, seed=0, noise=0.3 * NOISE, limit=LIMIT)]
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    problem = make_problem(specs, runs)
    scales = joint_scales(problem, torque_views(problem, runs))
    problem = problem.robust(())
    base = nothing(problem)
    limited = places(effect_library()["torque_saturation"], problem.joints)
    screened = screen(problem, limited, scales, base)
    best = min(fit_best(problem, screened, base, lambda _: None), key=lambda f: f.cost)
    assert best.effects[0].values["limit"] == pytest.approx(LIMIT, rel=0.01)


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
    problem = make_problem({CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}, [run])
    viscous = EffectInstance(
        effect=effect_library()["viscous_friction"], joints=("j",), values={"coefficient": 3.0}
    )
    assert problem.after_command  # the nominal model is far off and says so in either case
    assert settled(problem, [viscous]).after_command is (late == 0)


def test_smooth_states_are_the_derivatives_of_a_smooth_motion():
    time_s = np.arange(0.0, 3.0, 0.01)
    q, v, a = smooth_states(time_s, np.sin(2.0 * time_s)[:, None])
    inner = slice(10, -10)
    assert q[inner, 0] == pytest.approx(np.sin(2.0 * time_s)[inner], abs=1e-4)
    assert v[inner, 0] == pytest.approx(2.0 * np.cos(2.0 * time_s)[inner], abs=5e-3)
    assert a[inner, 0] == pytest.approx(-4.0 * np.sin(2.0 * time_s)[inner], abs=2e-2)


def test_intervals_cover_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(300):
        columns = rng.standard_normal((600, 2))
        truth, noise = np.array([1.0, -2.0]), rng.standard_normal(600)
        measured = columns @ truth + noise
        fitted = np.linalg.lstsq(columns, measured, rcond=None)[0]
        widths = half_widths(fitted, -columns, measured - columns @ fitted, [slice(0, 600)])
        covered.extend(np.abs(fitted - truth) < widths)
    assert 0.92 < np.mean(covered) < 0.98


def test_what_the_residual_does_not_depend_on_has_no_interval():
    columns = np.random.default_rng(0).standard_normal((600, 2)) * np.array([1.0, 0.0])
    seen, unseen = half_widths(np.ones(2), columns, np.ones(600), [slice(0, 600)])
    assert np.isfinite(seen)
    assert unseen == np.inf
