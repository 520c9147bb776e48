"""Names for learned forces: laws that a force model was given are found in its forces."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.diagnosis.learned import learned_report
from gfm.diagnosis.residuals.problem import Problem
from gfm.sim.features import make_features
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import LearnedForces
from gfm.sim.learned_along import joint_forces_along
from gfm.sim.replay import make_replay

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody><body>
    <joint name="j" axis="0 -1 0" armature="0.02"/>
    <inertial pos="0 0 -0.2" mass="0.5" diaginertia="1e-9 1e-9 1e-9"/>
    <geom size="0.01" mass="0"/>
  </body></worldbody>
  <actuator><position name="j" joint="j" kp="20" kv="1"/></actuator>
</mujoco>
"""
SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
HYBRID = HybridModel(
    models={CommandKind.POSITION: mujoco.MjModel.from_xml_string(MODEL)}, control_period_s=0.02
)
LIMIT = 5.0


@dataclass(frozen=True)
class Law:
    """A policy that gives the forces of a law of the newest position and velocity."""

    features: object
    law: object
    action_size: int = 1

    @property
    def observation_size(self):
        return self.features.size

    def mean_action(self, observation):
        q, v = (observation[:, :2] * self.features.scale + self.features.mean).T
        return (self.law(q, v) / LIMIT).astype(np.float32)[:, None]


def recording(seed=0):
    """A motion of sines that stops in the end, under commands that have little to do with it."""
    stamps = np.arange(1200) * 0.01
    speeds, phases = np.random.default_rng(seed).uniform(1.0, 4.0, (2, 3))
    waves = 0.4 * np.sin(np.outer(np.minimum(stamps, 9.0), speeds) + phases).sum(axis=1)
    stamp_ns = np.round(stamps * 1e9).astype(np.int64)
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=waves[:, None] + 1e-5 * np.random.default_rng(seed).standard_normal((1200, 1)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=waves[:, None] + 0.1 * np.sin(5.0 * stamps)[:, None],
    )


RUNS = [recording(0), recording(1)]
FEATURES = make_features(HYBRID.layout, [make_replay(HYBRID, run) for run in RUNS], 5)
PROBLEM = Problem(specs=SPECS, joints=("j",), segments=(), noise=measure_noise(RUNS))


def learned(law, joint="j"):
    return LearnedForces(
        joint_names=(joint,),
        forced_joints=(joint,),
        on_object=False,
        force_limit=np.array([LIMIT]),
        control_period_s=0.02,
        features=FEATURES,
        policy=Law(FEATURES, law),
    )


def named(*laws):
    report = learned_report(PROBLEM, RUNS, [learned(law) for law in laws])
    return report, {n.instance.effect.name: dict(n.instance.values) for n in report.names}


def test_forces_along_a_motion_are_held_over_control_periods():
    force = joint_forces_along(learned(lambda _q, v: -0.3 * v), HYBRID, RUNS[0])
    replay = make_replay(HYBRID, RUNS[0])
    assert force.shape == (1200, 1)
    velocity = replay.qvel[:, 0]
    np.testing.assert_allclose(force[200:-2:2, 0], -0.3 * velocity[100:-1], atol=1e-3)
    np.testing.assert_array_equal(force[201:-2:2], force[200:-3:2])


def test_dry_and_viscous_friction_in_learned_forces_get_their_names_and_amounts():
    report, found = named(lambda _q, v: -0.3 * np.tanh(v / 0.01) - 0.2 * v)
    assert set(found) == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"]["torque"] == pytest.approx(0.3, rel=0.05)
    assert found["viscous_friction"]["coefficient"] == pytest.approx(0.2, rel=0.1)
    assert report.named_share > 0.97
    assert report.joints[0].named == pytest.approx(report.named_share)


def test_a_spring_in_learned_forces_has_its_rest_angle():
    _, found = named(lambda q, _v: -1.5 * (q - 0.2))
    assert list(found) == ["joint_spring"]
    assert found["joint_spring"]["stiffness"] == pytest.approx(1.5, rel=0.03)
    assert found["joint_spring"]["rest_angle"] == pytest.approx(0.2, abs=0.02)


def test_what_is_no_law_of_the_library_stays_without_a_name():
    rng = np.random.default_rng(0)
    report, found = named(lambda q, _v: rng.standard_normal(len(q)))
    assert found == {}
    assert report.named_share == 0.0


def test_forces_that_are_small_beside_the_drive_are_not_asked():
    report, found = named(lambda _q, v: -1e-4 * v)
    assert found == {}
    assert report.joints[0].named is None


def test_members_of_an_ensemble_are_averaged_and_their_spread_is_told():
    report, found = named(lambda _q, v: -0.6 * v, lambda _q, v: -0.2 * v)
    assert found["viscous_friction"]["coefficient"] == pytest.approx(0.4, rel=0.05)
    assert report.spread == pytest.approx(0.5, rel=0.01)
    assert report.members == 2


def test_forces_of_another_robot_are_refused():
    with pytest.raises(ConfigError, match="another robot: it observes k; recorded are j"):
        learned_report(PROBLEM, RUNS, [learned(lambda _q, v: v, joint="k")])


def test_a_recording_that_is_shorter_than_the_history_is_refused():
    short = replace(RUNS[0], stamp_ns=RUNS[0].stamp_ns[:9], position=RUNS[0].position[:9])
    with pytest.raises(ConfigError, match="the force model looks back 5"):
        joint_forces_along(learned(lambda _q, v: v), HYBRID, short)
