"""Ranges of amounts: written by a diagnosis of several sets, drawn from by training."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import BadInputError, CommandKind, ConfigError
from gfm.diagnosis.output.changes import Changes, SetAmount
from gfm.diagnosis.search.sets import Course
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.envs.control_settings import ControlSettings
from gfm.envs.joint_tracking import JointTracking
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSITION_MATCHING
from gfm.envs.matching_view import MatchingView
from gfm.envs.registry import EnvironmentSettings, arm_problem, furnished
from gfm.report.ranges import ranges_toml
from gfm.service.assets import load_assets, load_environment
from gfm.service.ranges_file import read_ranges
from gfm.sim.cell import END_EFFECTOR_SITE
from gfm.sim.kinematics import SiteKinematics
from gfm.sim.sawyer import sawyer_spec

JOINT = "right_j1"
CONFIGS = Path(__file__).parents[2] / "configs"


def amount(effect, parameter, low, high, **more):
    told = {
        "joints": (JOINT,),
        "unit": "N m",
        "course": Course.DRIFTS,
        "values": (low, high),
        "errors": (0.0, 0.0),
        "seen": (True, True),
        "already": None,
        "mean": 0.5 * (low + high),
        "spread": 0.1,
        "credible": True,
    }
    return SetAmount(effect=effect, parameter=parameter, low=low, high=high, **(told | more))


AMOUNTS = (
    amount("coulomb_friction", "torque", 0.5, 1.5),
    amount("load_dependent_friction", "coefficient", 0.02, 0.04),
    amount("viscous_friction", "coefficient", 3.0, 4.0, credible=False),
)


def files(folder, amounts=AMOUNTS):
    changes = Changes(sentence="", sets=(), amounts=amounts)
    ranges, model = folder / "ranges.toml", folder / "robot.xml"
    ranges.write_text(ranges_toml(changes))
    model.write_text(sawyer_spec(command=CommandKind.VELOCITY).to_xml())
    return ranges, model


def settings(ranges, model, variants=8):
    return EnvironmentSettings(
        models={CommandKind.VELOCITY: str(model)},
        control=ControlSettings(ranges=str(ranges), variants=variants),
    )


def test_what_is_written_is_read_without_what_is_doubtful(tmp_path):
    told = read_ranges(files(tmp_path)[0])
    assert [(one.usual.effect.name, one.usual.joints) for one in told] == [
        ("coulomb_friction", (JOINT,)),
        ("load_dependent_friction", (JOINT,)),
    ]
    assert [(one.low, one.usual.values, one.high) for one in told[:1]] == [
        ({"torque": 0.5}, {"torque": 1.0}, {"torque": 1.5})
    ]


def test_a_file_without_ranges_is_a_file_of_ranges(tmp_path):
    assert read_ranges(files(tmp_path, amounts=())[0]) == ()


def test_models_are_drawn_within_the_ranges_and_share_what_mujoco_cannot_say(tmp_path):
    ranges, model = files(tmp_path)
    assets = load_assets(settings(ranges, model))
    nominal = mujoco.MjModel.from_xml_path(str(model))
    dof = nominal.joint(JOINT).dofadr[0]
    own = np.array(
        [m.dof_frictionloss[dof] - nominal.dof_frictionloss[dof] for m in assets.drawn.variants]
    )
    assert len(own) == 8
    assert ((own >= 0.5) & (own <= 1.5)).all()
    assert np.ptp(own) > 0.3
    assert [e.values for e in assets.effects] == [{"coefficient": pytest.approx(0.03)}]
    others = np.delete([m.dof_frictionloss for m in assets.drawn.variants], dof, axis=1)
    np.testing.assert_array_equal(others, np.tile(others[0], (8, 1)))


def test_episodes_of_a_control_task_have_different_drawn_models(tmp_path):
    ranges, model = files(tmp_path, AMOUNTS[:1])
    told = settings(ranges, model)
    problem = arm_problem("joint_tracking", told, load_assets(told))
    assert problem.variants == problem.drawn.variants
    env = JointTracking(problem, 16, seed=0)
    env.reset()
    for _ in range(round(0.5 / CONTROL_PERIOD_S)):
        env.step(np.ones((16, 7), np.float32))
    made = load_environment("joint_tracking", told, num_envs=2, seed=0)
    assert made.reset().shape[0] == 2


def test_a_policy_sees_the_tool_where_encoders_tell_and_is_paid_for_where_it_is(tmp_path):
    ranges, model = files(tmp_path, (amount("encoder_offset", "offset", -0.05, 0.07),))
    told = settings(ranges, model)
    problem = arm_problem(
        "position_matching", told, load_assets(told, partial(furnished, "position_matching"))
    )
    layout, tool = problem.model.layout, SiteKinematics(problem.nominal, END_EFFECTOR_SITE)
    joint = layout.qpos[layout.joint_names.index(JOINT)]
    known = problem.nominal.qpos0[joint]
    assert known == pytest.approx(0.01)  # the mean of the range
    env = Matching(POSITION_MATCHING, problem, 16, seed=0)
    seen, scene, qpos = env.reset(), env.scene(), env.qpos

    view = MatchingView(POSITION_MATCHING, problem.velocity_limit, 16)
    encoders = replace(scene, tip=tool.positions(qpos))
    joints = qpos[:, layout.qpos] - problem.zero
    view.begin(np.arange(16), joints, np.zeros((16, 7)), encoders)
    np.testing.assert_array_equal(seen, view.observation(encoders, env.goal))

    def away(misread):
        """Returns how far the tool is from where it is if the joint is off by so much."""
        true = qpos.copy()
        true[:, joint] -= misread
        return np.linalg.norm(scene.tip - tool.positions(true), axis=1)

    every = np.array([away(one.qpos0[joint] - known) for one in problem.variants])
    np.testing.assert_allclose(every.min(axis=0), 0.0, atol=1e-9)
    assert away(0.0).max() > 0.02


def test_the_wide_ranges_are_of_the_published_cell(tmp_path):
    _, model = files(tmp_path)
    told = settings(CONFIGS / "ranges/wide.toml", model)
    assets = load_assets(told, partial(furnished, "position_matching"))
    usual = assets.drawn.usual
    for one, mass in ((usual, 0.0), *((drawn, 0.075) for drawn in assets.drawn.variants)):
        assert one.body("object").mass[0] == pytest.approx(0.15, abs=mass + 1e-9)
        assert one.nbody == usual.nbody
    env = load_environment("position_matching", told, num_envs=2, seed=0)
    assert np.isfinite(env.reset()).all()
    misread = np.array([one.joint(JOINT).qpos0[0] for one in assets.drawn.variants])
    assert np.abs(misread).max() <= 0.06
    assert np.ptp(misread) > 0.04


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema = 1", "schema 1, expected gfm.ranges/1"),
        ("x", "not TOML"),
        (
            'schema = "gfm.ranges/1"\n[[effects]]\neffect = "strange"\njoints = []',
            "unknown effect 'strange'",
        ),
        (
            'schema = "gfm.ranges/1"\n[[effects]]\neffect = "armature"\njoints = ["a"]\n'
            "[effects.parameters]\ninertia = { mean = 1, low = 2, high = 1 }",
            "expected possible amounts, low before high",
        ),
        (
            'schema = "gfm.ranges/1"\n[[effects]]\neffect = "armature"\njoints = []\n'
            "[effects.parameters]\ninertia = { mean = 1, low = 1, high = 1 }",
            "armature on no joint; expected 1",
        ),
    ],
)
def test_another_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "ranges.toml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message) as refused:
        read_ranges(path)
    assert str(path) in str(refused.value)


def test_ranges_of_another_robot_are_refused_in_one_line(tmp_path):
    ranges, model = files(tmp_path)
    ranges.write_text(ranges.read_text().replace(JOINT, "elbow"))
    with pytest.raises(
        BadInputError, match=r"ranges .*coulomb_friction on joint 'elbow', which .*"
    ):
        load_assets(settings(ranges, model))


def test_ranges_need_the_model_that_was_diagnosed(tmp_path):
    ranges, _ = files(tmp_path)
    told = EnvironmentSettings(control=ControlSettings(ranges=str(ranges)))
    with pytest.raises(ConfigError, match=r"expected beside it the model .* \(models.velocity\)"):
        load_assets(told)


def test_ranges_and_randomisation_contradict_each_other():
    with pytest.raises(ConfigError, match=r"ranges is r\.toml and randomisation 0\.5"):
        ControlSettings(ranges="r.toml", randomisation=0.5)
