"""Predictions with effects that MuJoCo cannot express keep their numbers, digit by digit.

The figures were made by `figures` below with mujoco 4.0.0, before step laws and gravity
compensation had modules of their own (backlash after its motor side's microscopic mass was put on
the axis; friction that changes with the state after it was taken from the middle of a step; a motor
side since it begins under its load, and bears the compensation; torques since they are those of
the state at their instant; lags since they are exact; elasticity since a motor's friction has the
settings of its link's; dry friction since it holds as well as MuJoCo lets it; what a compensation
errs since it is taken at the middle of a step; tilted gravity since it pulls at all bodies). A
diagnosis fits to such numbers: they must not move unseen.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.effects import EffectInstance, find_effect
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Segment

ARM = (Path(__file__).parents[1] / "data" / "compensated_arm.xml").read_text()
CASES = {
    "stribeck": [("stribeck_friction", "a", {"static_excess": 0.6, "stribeck_velocity": 0.15})],
    "load": [("load_dependent_friction", "b", {"coefficient": 0.3})],
    "both at once": [
        ("stribeck_friction", "a", {"static_excess": 0.6, "stribeck_velocity": 0.15}),
        ("load_dependent_friction", "a", {"coefficient": 0.2}),
        ("command_delay", "ab", {"delay": 0.0137}),
        ("encoder_offset", "b", {"offset": 0.08}),
    ],
    "delay and lag": [
        ("command_delay", "ab", {"delay": 0.0137}),
        ("actuator_lag", "a", {"time_constant": 0.031}),
    ],
    "encoder offset under compensation": [("encoder_offset", "a", {"offset": 0.1})],
    "tilt under compensation": [("gravity_direction", "", {"tilt_x": 0.02, "tilt_y": 0.1})],
    "backlash": [("backlash", "b", {"gap": 0.02})],
    "elasticity and friction": [
        ("joint_elasticity", "a", {"stiffness": 200.0}),
        ("load_dependent_friction", "a", {"coefficient": 0.2}),
    ],
}
#: Position of both joints and drive torque of both at 0.4 s, then the same at 0.99 s.
EXPECTED = {
    "stribeck": [
        0.42198837666677924,
        0.10056782319887048,
        -1.836988333675091,
        -0.3129277395247119,
        -0.42418639884099496,
        -0.2749024230961582,
        1.664814629194165,
        0.3273294287679773,
    ],
    "load": [
        0.42176578220147837,
        0.10889677434275512,
        -1.8413720771944249,
        -0.47984041102534386,
        -0.4236446269058923,
        -0.28145861290292923,
        1.6489899200297398,
        0.5103962377102413,
    ],
    "both at once": [
        0.4147637029827654,
        0.11648868651552186,
        -1.7259971139977393,
        -0.39868745295746716,
        -0.4133225195113789,
        -0.2839300536082193,
        1.3885874475244613,
        0.3625325033547338,
    ],
    "delay and lag": [
        0.39870421359681985,
        0.10982802936900149,
        -1.7804928305092087,
        -0.3432454315372554,
        -0.39283750325573935,
        -0.27942472669935137,
        1.5471783025930446,
        0.3445111716841973,
    ],
    "encoder offset under compensation": [
        0.4264913241141551,
        0.10224213668271144,
        -1.8733477497816247,
        -0.3140784636199925,
        -0.4298601324775365,
        -0.27738016621184297,
        1.6862183329451583,
        0.3313080928841687,
    ],
    "tilt under compensation": [
        0.4264686054420421,
        0.10223493464971985,
        -1.8733862125996308,
        -0.3140853891235576,
        -0.42987950101379585,
        -0.27738539420038205,
        1.6861925036347931,
        0.33130262268211974,
    ],
    "backlash": [
        0.42207928428692165,
        0.11090488435674511,
        -1.8457800996680973,
        -0.30878795746279414,
        -0.42425062335492947,
        -0.26487835154407724,
        1.6689876715750191,
        0.3283850036493634,
    ],
    "elasticity and friction": [
        0.4386717527211067,
        0.1015003780843853,
        -1.6467511152879855,
        -0.338840988745369,
        -0.40877776806032595,
        -0.2765239149191619,
        1.4033976416284943,
        0.33590947856934017,
    ],
}


def figures(case):
    effects = [
        EffectInstance(effect=find_effect(name), joints=tuple(joints), values=values)
        for name, joints, values in CASES[case]
    ]
    time_s = np.arange(0.0, 1.0, 0.01)
    command = np.stack([0.4 * np.sin(5.0 * time_s), 0.3 * np.cos(4.0 * time_s)], axis=1)
    run = Segment(
        time_s=time_s,
        position=command,
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=time_s + 0.0007,
        command=command,
        initial_position=command[0],
        initial_velocity=np.array([2.0, 0.0]),
        servo_gain=np.array([1.0, 0.9]),
    )
    plant = make_plant(mujoco.MjSpec.from_string(ARM), ("a", "b"), effects)
    told = predict([plant], [run])[0][0]
    rows = np.concatenate([told.position, told.effort], axis=1)[[40, 99]]
    return rows.ravel()


@pytest.mark.parametrize("case", CASES)
def test_a_prediction_keeps_its_numbers(case):
    assert figures(case) == pytest.approx(EXPECTED[case], rel=1e-9)
