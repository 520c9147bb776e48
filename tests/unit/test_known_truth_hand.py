"""The known-truth suite by another hand: another integrator, other clocks, unsayable torques."""

import json
from dataclasses import replace
from functools import partial

import diagnosis
import numpy as np
import pytest
from known_truth import another_hand
from known_truth import generate as generation
from known_truth.amounts import Hidden
from known_truth.another_hand import by_another_hand
from known_truth.draft import draft
from known_truth.plans import plans
from known_truth.planted import discrepancy, ripple, side_by_side, usual_laws
from known_truth.recordings import Sensors, write_recording
from known_truth.robots import PENDULUM, PLANAR, SPATIAL
from known_truth.run import STEP_S, Course, Run
from known_truth.simulation import simulate, simulate_beside

from gfm.api.recordings import read_recordings


def servo(robot, *effects, seconds=0.3, **more):
    """Returns a run in which position servos follow an oscillation, commanded every 10 ms."""
    time_s = 0.01 * np.arange(round(seconds / 0.01) + 1)
    wave = np.sin(5.0 * time_s)[:, None] * 0.3 * robot.reach
    return Run(
        robot=robot,
        kind="position",
        hidden=effects,
        start=robot.rest,
        first_command_step=0,
        command_every=20,
        reference=robot.rest + wave,
        control=(robot.stiffness, robot.servo_damping),
        measured_at=np.arange(0, round(seconds / STEP_S) + 1, 10),
        **more,
    )


def explicit(run, finer=2):
    return replace(
        run,
        step_s=run.step_s / finer,
        first_command_step=finer * run.first_command_step,
        command_every=finer * run.command_every,
        measured_at=finer * run.measured_at,
        explicit=True,
    )


def hidden(effect, joint, **parameters):
    return Hidden(effect=effect, joints=(joint,), parameters=parameters)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (hidden("coulomb_friction", 1, torque=0.3),),
        (hidden("command_delay", 0, delay=0.0073),),
        (hidden("actuator_lag", 0, time_constant=0.02),),
        (hidden("joint_elasticity", 1, stiffness=200.0),),
    ],
    ids=["nothing", "dry friction", "delay", "lag", "elasticity"],
)
def test_both_integrators_agree_within_a_tenth_of_the_noise(effects):
    run = servo(PLANAR, *effects)
    (one,), (other,) = (simulate([each], settling_s=0.05) for each in (run, explicit(run)))
    assert np.ptp(one.position, axis=0).min() > 0.1
    assert np.abs(one.position - other.position).max() < 0.1 * PLANAR.encoder_noise


def test_dry_friction_holds_a_joint_for_good_in_the_other_integrator_too():
    held = replace(PENDULUM, friction=np.array([0.5]), stiffness=np.zeros(1))
    run = replace(servo(held), start=np.array([0.4]))
    (course,) = simulate([explicit(run)], settling_s=0.0)
    assert (course.position == 0.4).all()


def test_play_before_a_light_link_does_not_shake_in_the_other_integrator():
    run = servo(SPATIAL, hidden("backlash", 6, gap=0.01))
    (one,), (other,) = (simulate([each], settling_s=0.2) for each in (run, explicit(run)))
    assert np.abs(one.position - other.position).max() < 0.01


def test_the_discrepancy_is_what_the_usual_laws_cannot_say():
    drawn = discrepancy(PLANAR, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    place, speed = rng.uniform(-1.0, 1.0, (2, 5000, 2))
    times_s = rng.uniform(0.0, 240.0, 5000)
    q, v = PLANAR.rest + PLANAR.reach * place, PLANAR.speed * speed
    torque = np.stack([drawn.torque(*at) for at in zip(times_s, q, v, strict=True)])
    assert np.sqrt(np.mean(torque**2, axis=0)) == pytest.approx(PLANAR.torque, rel=0.05)
    laws = usual_laws(place, speed)
    for j in range(2):
        amounts = np.linalg.lstsq(laws[:, j], torque[:, j])[0]
        assert np.sqrt(np.mean((laws[:, j] @ amounts) ** 2)) < 0.06 * PLANAR.torque[j]


def test_slow_time_goes_on_from_one_recording_to_the_next():
    drawn = discrepancy(PLANAR, np.random.default_rng(3))
    q, v = PLANAR.rest + 0.1, 0.2 * PLANAR.speed
    assert drawn.in_recording(2).torque(1.0, q, v) == pytest.approx(drawn.torque(61.0, q, v))


def test_torques_on_one_robot_add_and_beside_others_do_not():
    rng = np.random.default_rng(5)
    one, gear = discrepancy(PLANAR, rng), ripple(PLANAR, rng)
    q, v = np.array([0.3, -0.2]), np.array([0.5, 0.1])
    both = one.beside(gear)
    assert both.torque(0.5, q, v) == pytest.approx(one.torque(0.5, q, v) + gear.torque(0.5, q, v))
    many = side_by_side([both, None])
    assert many is not None
    torque = many.torque(0.5, np.stack([q, q]), np.stack([v, v]))
    assert torque[0] == pytest.approx(both.torque(0.5, q, v))
    assert (torque[1] == 0.0).all()
    assert side_by_side([None, None]) is None


def test_a_gear_ripples_by_some_thousandths_of_the_usual_torque():
    gear = ripple(PENDULUM, np.random.default_rng(6))
    turn = np.linspace(0.0, 2.0 * np.pi, 5000)[:, None]
    torque = gear.torque(0.0, turn, np.zeros_like(turn))
    assert 1e-3 < np.abs(torque).max() / PENDULUM.torque[0] <= 3e-3
    assert torque[-1] == pytest.approx(torque[0])


def test_others_that_are_the_same_do_not_come_apart():
    run = servo(PLANAR)
    lighter = replace(run, robot=replace(PLANAR, mass=0.9 * PLANAR.mass))
    same, other = simulate_beside([run, run], [run, lighter], segment_s=0.1, settling_s=0.0)
    assert (same[0].position == same[1].position).all()
    apart = np.abs(other[0].position - other[1].position).max(axis=1)
    assert apart[10] > 1e-5
    # At 0.1 s, the 20th measurement, it has begun anew.
    assert apart[20] == 0.0


@pytest.fixture
def case(monkeypatch):
    monkeypatch.setattr(another_hand, "_MEASURED_S", 0.5)
    beside = partial(simulate_beside, settling_s=0.1)
    monkeypatch.setattr(another_hand, "simulate_beside", beside)
    (plan,) = (p for p in plans() if p.name == "pendulum_position-none_0")
    return replace(plan, excitation="short")


@pytest.mark.parametrize("asked", [0.0, 3.0])
def test_the_discrepancy_changes_the_motion_by_what_is_asked(case, asked):
    one = draft(case)
    (work,) = by_another_hand([one], asked)
    assert work.changes == pytest.approx([asked], rel=0.01)
    assert work.sensors.stamp_noise_s > 0.0
    assert (work.torques > 0.0).all() == (asked > 0.0)
    assert all(run.explicit and run.planted is not None for run in work.runs)


@pytest.mark.slow
def test_a_case_tells_by_whose_hand_it_is(case, tmp_path, monkeypatch):
    monkeypatch.setattr(generation, "simulate", partial(simulate, settling_s=0.1))
    generation.generate([case], tmp_path, discrepancy=3.0)
    truth = json.loads((tmp_path / "truth" / f"{case.name}.json").read_text())
    assert truth["hand"] == "other"
    assert truth["discrepancy"]["asked"] == 3.0
    (recording, *_) = read_recordings(sorted((tmp_path / "cases" / case.name).glob("held*.mcap")))
    uneven = np.diff(recording.stamp_ns) % round(1e9 * STEP_S)
    assert len(set(uneven.tolist())) > 50


@pytest.mark.parametrize(
    ("made", "asked", "words"),
    [
        (3.0, None, "is by another hand with discrepancy 3, asked for is the own hand"),
        (None, 1.0, "is by the own hand, asked for is another hand with discrepancy 1"),
        (3.0, 1.0, "discrepancy 3, asked for is another hand with discrepancy 1"),
    ],
)
def test_a_case_is_not_taken_for_another_hands(made, asked, words, case, tmp_path):
    told = {"hand": "own"} if made is None else {"hand": "other", "discrepancy": {"asked": made}}
    file = tmp_path / "truth" / f"{case.name}.json"
    file.parent.mkdir()
    file.write_text(json.dumps(told))
    with pytest.raises(ValueError, match=words):
        generation.generate([case], tmp_path, asked)


def test_stamps_err_by_what_is_said(tmp_path):
    run = replace(servo(PENDULUM, seconds=10.0), reference=np.zeros((2, 1)))
    still = np.zeros((len(run.measured_at), 1))
    course = Course(position=still, velocity=still, servo=still, effort=still, command=still[:2])
    clocks = []
    for name, noise_s in (("exact", 0.0), ("noisy", 3e-5)):
        sensors = Sensors(
            encoder_step=1e-4,
            encoder_noise=1e-4,
            velocity_noise=None,
            effort_noise=None,
            stamp_noise_s=noise_s,
        )
        path = tmp_path / f"{name}.mcap"
        write_recording(path, run, course, sensors, np.random.default_rng(1))
        clocks.append(read_recordings([path])[0].stamp_ns * 1e-9)
    assert np.ptp(np.diff(clocks[0])) < 1e-6
    assert np.std(np.diff(clocks[1])) == pytest.approx(np.sqrt(2.0) * 3e-5, rel=0.1)


def test_the_page_says_by_whose_hand():
    assert "implicit midpoint" in diagnosis.simulated_by(None)
    assert "about 3 sensor noises" in diagnosis.simulated_by(3.0)
