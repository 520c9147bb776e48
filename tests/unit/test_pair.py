"""A corrected model as two files: found together, refused when damaged, as good as in memory."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.api.models import load_nominal
from gfm.core import BadInputError, CommandKind, ConfigError, Trajectory, UnknownNameError
from gfm.diagnosis.output.correction import corrected_model, model_pair
from gfm.diagnosis.output.result import NamedEffect, ParameterEstimate
from gfm.effects import EffectInstance, find_effect
from gfm.envs.registry import EnvironmentSettings
from gfm.experiments.run import nominal_arm
from gfm.recording.writer import write_recording
from gfm.report.files import model_texts, write_texts
from gfm.service.assets import load_environment
from gfm.service.model_files import read_model
from gfm.sim.hybrid import HybridModel
from gfm.sim.plant import make_plant, native_spec, stepping_spec
from gfm.sim.predict import predict
from gfm.sim.residual import residual_forces
from gfm.sim.rollout import rollouts
from two_joints import a_segment

#: Its dry friction creeps; that of ARM holds, as in every corrected model.
CREEPING_ARM = (Path(__file__).parents[1] / "data" / "compensated_arm.xml").read_text()
HOLDING = 'solreffriction="0.004" solimpfriction="0.9999 0.9999"'
ARM = CREEPING_ARM.replace('frictionloss="0.05"', f'frictionloss="0.05" {HOLDING}')
VELOCITY_ARM = ARM.replace("<position", "<velocity").replace('kp="30"', "").replace('kp="15"', "")
JOINTS = ("a", "b")


def effect(name, joints, **values):
    return EffectInstance(effect=find_effect(name), joints=tuple(joints), values=values)


def named(instance):
    units = {p.name: p.unit for p in instance.effect.parameters}
    return NamedEffect(
        effect=instance.effect.name,
        joints=instance.joints,
        parameters={
            name: ParameterEstimate(value=value, unit=units[name], ci95=(0.9 * value, 1.1 * value))
            for name, value in instance.values.items()
        },
        confidence=0.9,
        native=instance.effect.native,
    )


LOAD = effect("load_dependent_friction", "b", coefficient=0.3)
STRIBECK = effect("stribeck_friction", "a", static_excess=0.6, stribeck_velocity=0.15)
DELAY = effect("command_delay", "ab", delay=0.0137)
LAG = effect("actuator_lag", "a", time_constant=0.031)
OFFSET = effect("encoder_offset", "a", offset=0.1)
TILT = effect("gravity_direction", "", tilt_x=0.02, tilt_y=0.1)
#: What a robot may have, and which of it stands beside the MJCF file.
CASES = {
    "friction with load": ([LOAD], ["load_dependent_friction"]),
    "stribeck, delay and lag": ([STRIBECK, DELAY, LAG], ["stribeck_friction"]),
    "encoder offset": ([OFFSET], ["encoder_offset"]),
    "tilt": ([TILT], ["gravity_direction"]),
    "tilt, offset and friction": (
        [TILT, OFFSET, LOAD],
        ["gravity_direction", "encoder_offset", "load_dependent_friction"],
    ),
    "late servo and friction": (
        [effect("servo_delay", "ab", delay=0.0037), LOAD],
        ["servo_delay", "load_dependent_friction"],
    ),
    "late sensors and another clock": (
        [
            effect("position_delay", "ab", delay=0.0137),
            effect("effort_delay", "ab", delay=0.004),
            effect("clock_offset", "ab", offset=-0.003),
        ],
        ["position_delay", "effort_delay", "clock_offset"],
    ),
    "backlash and friction": (
        [effect("backlash", "b", gap=0.02), effect("coulomb_friction", "b", torque=0.1), STRIBECK],
        ["backlash", "stribeck_friction"],
    ),
    "elasticity, cogging and payload": (
        [
            effect("joint_elasticity", "a", stiffness=200.0),
            effect("cogging_torque", "a", amplitude=0.2, per_revolution=10.0, phase=0.3),
            effect("payload", "b", mass=0.2, com_x=0.1, com_y=0.0, com_z=0.05),
        ],
        ["joint_elasticity"],  # where the drive's compensation acts
    ),
}


def written(folder, effects, given=(), spec=None):
    """Writes the corrected model of ARM; returns the path of the MJCF file."""
    nominal = spec or mujoco.MjSpec.from_string(ARM)
    pair = corrected_model(nominal, [named(e) for e in effects], given)
    write_texts(folder, model_texts("corrected", pair))
    return folder / "corrected.xml"


@pytest.mark.parametrize("case", CASES)
def test_plain_mujoco_loads_the_corrected_model(case, tmp_path):
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, CASES[case][0])))
    expected = native_spec(mujoco.MjSpec.from_string(ARM), CASES[case][0]).compile()
    data = [mujoco.MjData(one) for one in (model, expected)]
    for one, moved in zip((model, expected), data, strict=True):
        moved.ctrl[:] = 0.2
        one.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        mujoco.mj_step(one, moved, nstep=100)
    assert data[0].qpos == pytest.approx(data[1].qpos, abs=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_beside_it_stands_what_mjcf_cannot_say(case, tmp_path):
    effects, beside = CASES[case]
    file = read_model(written(tmp_path, effects))
    assert [one.effect.name for one in file.effects] == beside
    assert [one.in_model for one in file.effects] == [
        one.effect.native for one in effects if one.effect.name in beside
    ]


@pytest.mark.parametrize("case", CASES)
def test_the_pair_predicts_what_the_corrected_model_in_memory_predicts(case, tmp_path):
    effects, _ = CASES[case]
    spec = mujoco.MjSpec.from_string(ARM)
    file = read_model(written(tmp_path, effects))
    plants = [make_plant(spec, JOINTS, effects), make_plant(file.spec, JOINTS, file.effects)]
    (in_memory,), (pair,) = predict(plants, [a_segment(servo_gain=(1.0, 0.9))])
    # MJCF text has six digits.
    assert pair.position == pytest.approx(in_memory.position, abs=2e-5)
    assert pair.effort == pytest.approx(in_memory.effort, abs=1e-2)
    nominal = predict([make_plant(spec, JOINTS)], [a_segment(servo_gain=(1.0, 0.9))])[0][0]
    assert np.abs(nominal.position - in_memory.position).max() > 1e-3


def test_who_reads_the_pair_is_told_what_stepping_leaves_out(tmp_path):
    file = read_model(written(tmp_path, CASES["late servo and friction"][0]))
    assert any("servo_delay: stepped simulations take its commands late" in x for x in file.about)
    assert hybrid(file.spec, file.effects).any_model.actuator_delay[0] == pytest.approx(0.0037)


def recording_of(effects):
    """Returns 2 s of the robot that has these effects, at rest before its first command."""
    time_s = np.arange(0.0, 2.0, 0.01)
    command = np.stack([0.4 * np.sin(4.0 * time_s), 0.3 * np.sin(3.0 * time_s)], axis=1)
    run = replace(
        a_segment(servo_gain=(1.0, 0.9)),
        time_s=time_s,
        position=command,
        command_time_s=time_s,
        command=command,
        initial_position=command[0],
        initial_velocity=np.zeros(2),
        servo_gain=np.ones(2),
    )
    plant = make_plant(mujoco.MjSpec.from_string(ARM), JOINTS, effects)
    for _ in range(2):  # a compensation that errs is evaluated along the measured motion
        run = replace(run, position=predict([plant], [run])[0][0].position)
    stamp_ns = np.round(time_s * 1e9).astype(np.int64)
    return Trajectory(
        name="run",
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=run.position,
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command,
    )


def hybrid(spec, effects=()):
    model = stepping_spec(spec, effects).compile()
    return HybridModel(
        models={CommandKind.POSITION: model},
        joint_names=JOINTS,
        control_period_s=0.02,
        effects=tuple(effects),
    )


def rollout_error(model, recording):
    """Returns the RMSE once the start, where the smoothed state is off, is forgotten, rad."""
    (told,) = rollouts(model, [recording])
    error = recording.position[told.first :] - told.position
    return float(np.sqrt(np.mean(error[80:] ** 2)))


@pytest.mark.parametrize("case", ["friction with load", "encoder offset", "backlash and friction"])
def test_hybrid_stepping_of_the_pair_follows_the_robot_and_mjcf_alone_does_not(case, tmp_path):
    effects, _ = CASES[case]
    recording = recording_of(effects)
    file = read_model(written(tmp_path, effects))
    alone = rollout_error(hybrid(file.spec), recording)
    pair = rollout_error(hybrid(file.spec, file.effects), recording)
    assert pair < 5e-5
    assert pair < 0.05 * alone


def test_many_instances_step_as_each_alone(tmp_path):
    file = read_model(written(tmp_path, [STRIBECK, LOAD, OFFSET]))
    model, recording = hybrid(file.spec, file.effects), recording_of([STRIBECK])
    slower = replace(recording, name="slower", command=0.5 * recording.command)
    together = rollouts(model, [recording, slower])
    alone = rollouts(model, [slower])[0]
    np.testing.assert_array_equal(together[1].position, alone.position)


def test_a_robot_that_is_its_pair_needs_no_further_force(tmp_path):
    recording = recording_of([LOAD, OFFSET])
    file = read_model(written(tmp_path, [LOAD, OFFSET]))
    forces = [
        residual_forces(hybrid(file.spec, effects), recording)[5:-5]
        for effects in ((), file.effects)
    ]
    alone, pair = (np.sqrt(np.mean(force**2, axis=0)) for force in forces)
    assert (pair < 0.2 * alone).all()


def test_gfm_fit_runs_on_the_pair(tmp_path):
    recording = recording_of([LOAD, OFFSET])
    path = written(tmp_path, [LOAD, OFFSET])
    write_recording(tmp_path / "run.mcap", recording)
    (tmp_path / "alone.xml").write_text(path.read_text())
    rewards = []
    for file in (tmp_path / "alone.xml", path):
        settings = EnvironmentSettings(
            models={CommandKind.POSITION: str(file)},
            recordings=(str(tmp_path / "run.mcap"),),
            control_period_s=0.02,
            horizon=20,
            scale=(0.01, 0.01, 0.2, 0.2),
        )
        env = load_environment("gfm_fit", settings, num_envs=4, seed=0)
        env.reset()
        still = np.zeros((4, env.spec.action_size), np.float32)
        rewards.append(np.mean([env.step(still).reward for _ in range(20)]))
    assert rewards[1] > 0.97
    assert rewards[0] < 0.9


def test_the_arm_of_a_run_may_be_a_pair_for_both_of_its_modes(tmp_path):
    published = nominal_arm(())
    load = replace(LOAD, joints=("right_j2",))
    for kind, spec in published.specs.items():
        pair = corrected_model(spec, [named(load)])
        write_texts(tmp_path, model_texts(f"corrected_{kind}", pair))
    paths = sorted(tmp_path.glob("*.xml"))
    arm = nominal_arm(paths)
    assert (arm.effects, len(arm.about)) == ((load,), 2)
    with pytest.raises(ConfigError, match="models for position commands; expected one for each"):
        nominal_arm(paths[:1])
    others = [written(tmp_path, []), tmp_path / "other.xml"]
    others[1].write_text(VELOCITY_ARM)
    with pytest.raises(UnknownNameError, match="unknown joint 'right_j0'; available: a, b"):
        nominal_arm(others)


def test_meshes_are_found_from_any_folder(tmp_path):
    cell = tmp_path / "cell"
    (cell / "assets").mkdir(parents=True)
    corners = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    (cell / "assets" / "box.obj").write_text(
        "".join("v " + " ".join(str(0.1 * c) for c in corner) + "\n" for corner in corners)
        + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    )
    mesh = '<asset><mesh name="box" file="box.obj"/></asset><worldbody>'
    mesh += '<geom type="mesh" mesh="box" contype="0" conaffinity="0"/>'
    text = ARM.replace('angle="radian"', 'angle="radian" meshdir="assets"')
    (cell / "arm.xml").write_text(text.replace("<worldbody>", mesh))
    spec = read_model(cell / "arm.xml").spec
    path = written(tmp_path / "out", [DELAY], spec=spec)
    assert mujoco.MjModel.from_xml_path(str(path)).nmesh == 1


def test_the_mjcf_says_every_effect_with_amount_and_interval_in_a_comment(tmp_path):
    text = written(tmp_path, [STRIBECK, DELAY]).read_text()
    assert "command_delay on a, b: delay 0.0137 [0.01233, 0.01507] s -->" in text
    assert "stribeck_friction on a: static_excess 0.6 [0.54, 0.66] N m" in text
    assert "(it cannot be said here: see the .effects.json beside)" in text


def test_every_line_that_changed_stands_below_what_it_was(tmp_path):
    lines = written(tmp_path, CASES["elasticity, cogging and payload"][0]).read_text().splitlines()
    told = {line.strip(): lines[i - 1].strip() for i, line in enumerate(lines)}
    said = 'axis="0 1 0" armature="0.05" damping="0.1" frictionloss="0.05"'
    joint = f'<joint name="a" {said} {HOLDING}/>'
    was = next(line for line in lines if line.strip().startswith("<!-- nominal: <joint"))
    assert sorted(was.split('"')[1::2]) == sorted(joint.split('"')[1::2])
    assert told['<body name="payload" pos="0.1 0 0.05">'] == "<!-- added -->"
    assert told["<actuator>"] != "<!-- added -->"
    drive = next(line for line in told if line.startswith('<general name="a" '))
    assert drive.split('joint="')[1].startswith("a_motor")
    assert told[drive].startswith('<!-- nominal: <general name="a" joint="a"')


def test_a_model_to_which_nothing_is_added_has_no_comment_but_the_integrators(tmp_path):
    euler = mujoco.MjSpec.from_string(ARM.replace('integrator="RK4"', ""))
    assert "<!--" not in written(tmp_path / "same", []).read_text()
    text = written(tmp_path / "euler", [], spec=euler).read_text()
    assert text.count("<!--") == 1
    assert "<!-- added -->\n  <option integrator" in text


def test_dry_friction_that_creeps_is_corrected_and_said(tmp_path):
    text = written(tmp_path, [], spec=mujoco.MjSpec.from_string(CREEPING_ARM)).read_text()
    assert HOLDING in text
    assert text.count("<!-- nominal: <joint") == 1


def test_a_corrected_pair_is_corrected_again_without_losing_anything(tmp_path):
    once = read_model(written(tmp_path, [STRIBECK, LAG, OFFSET]))
    path = written(tmp_path / "twice", [LOAD, LAG], once.effects, once.spec)
    twice = read_model(path)
    assert [e.key for e in twice.effects] == [STRIBECK.key, OFFSET.key, LOAD.key]
    assert [e.in_model for e in twice.effects] == [False, True, False]
    assert make_plant(twice.spec, JOINTS).effects[0].values["time_constant"] == pytest.approx(0.062)
    text = path.read_text()
    assert "<!-- As before: stribeck_friction on a: static_excess 0.6 N m" in text
    assert text.count("Corrected by gfm") == 1
    again = model_pair(twice.spec, twice.effects)
    assert [e.effect for e in again.effects] == [e.effect.name for e in twice.effects]


def test_a_model_without_effects_has_nothing_beside_it_any_more(tmp_path):
    assert read_model(written(tmp_path, [LOAD])).effects
    path = written(tmp_path, [DELAY])
    assert read_model(path).effects == ()
    assert [p.name for p in tmp_path.iterdir()] == ["corrected.xml"]


def test_what_was_found_is_said_in_one_line(tmp_path):
    (line,) = load_nominal([written(tmp_path, [STRIBECK, TILT])]).about
    assert line == (
        f"model {tmp_path / 'corrected.xml'}: with corrected.effects.json beside it: "
        "stribeck_friction on a, gravity_direction on all"
    )


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text[:-20], "expected JSON"),
        (lambda text: text.replace('"b"', '"elbow"'), "on joint 'elbow', which"),
        (lambda text: text.replace("gfm.effects/1", "gfm.effects/9"), "schema 'gfm.effects/9'"),
        (lambda text: text.replace("0.3", "3.0", 1), "out of bounds"),
    ],
)
def test_a_damaged_pair_is_refused_in_one_line(damage, words, tmp_path):
    path = written(tmp_path, [LOAD])
    beside = tmp_path / "corrected.effects.json"
    beside.write_text(damage(beside.read_text()))
    with pytest.raises(BadInputError, match=words) as caught:
        load_nominal([path])
    assert str(caught.value).startswith(f"effects {beside}: ")
    assert "\n" not in str(caught.value)


def test_models_of_one_robot_have_the_same_beside_them(tmp_path):
    position = written(tmp_path, [LOAD])
    velocity = tmp_path / "velocity.xml"
    velocity.write_text(VELOCITY_ARM)
    with pytest.raises(ConfigError, match="beside the first stand load_dependent_friction"):
        load_nominal([position, velocity])
    effects = json.loads((tmp_path / "corrected.effects.json").read_text())
    (tmp_path / "velocity.effects.json").write_text(json.dumps(effects))
    nominal = load_nominal([position, velocity])
    assert set(nominal.specs) == {CommandKind.POSITION, CommandKind.VELOCITY}
    assert [path.suffix for path in nominal.files] == [".xml", ".xml", ".json", ".json"]


def test_a_model_with_cogging_is_still_one_of_position_commands(tmp_path):
    path = written(tmp_path, CASES["elasticity, cogging and payload"][0])
    assert list(load_nominal([path]).specs) == [CommandKind.POSITION]
