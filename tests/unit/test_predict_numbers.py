"""Predictions with effects that MuJoCo cannot express keep their numbers, digit by digit.

The figures were made by `figures` below with mujoco 4.0.0, before step laws and gravity
compensation had modules of their own (backlash after its motor side's microscopic mass was put on
the axis; friction that changes with the state after it was taken from the middle of a step; a motor
side since it begins under its load, and bears the compensation). A diagnosis fits to such numbers:
they must not move unseen.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.effects import EffectInstance, find_effect
from gfm.sim.plant import make_plant
from gfm.sim.predict import Segment, predict

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
        0.4219883766667792,
        0.10056782319887059,
        -1.8394156959909669,
        -0.31052453202113844,
        -0.42418641955900227,
        -0.2749024286922491,
        1.6659680733853524,
        0.32602159889763893,
    ],
    "load": [
        0.4217657927609631,
        0.10889678538433258,
        -1.8421900183343123,
        -0.47867914610549744,
        -0.4236445854198864,
        -0.2814575902986684,
        1.649979611581033,
        0.5096661018909914,
    ],
    "both at once": [
        0.4147648084356531,
        0.11649180911874478,
        -1.7260698700742068,
        -0.3987638363657935,
        -0.41332323429767454,
        -0.2839308401652717,
        1.388637113449791,
        0.3625764423676872,
    ],
    "delay and lag": [
        0.3987001920832249,
        0.1098276793725936,
        -1.7698837564254504,
        -0.34323748789995545,
        -0.3928344265487118,
        -0.27942465760100127,
        1.5378174195759158,
        0.3445094323995854,
    ],
    "encoder offset under compensation": [
        0.4264929448563486,
        0.10224531483010231,
        -1.8747277194101648,
        -0.31224976606776567,
        -0.4298581225861739,
        -0.27738063206337443,
        1.6875391716324768,
        0.33005922617774663,
    ],
    "tilt under compensation": [
        0.426029102682713,
        0.10229124519637983,
        -5.201116003835722,
        -0.7919114530621996,
        -0.42971775077229923,
        -0.27740118088900517,
        -1.2718163634598367,
        -0.04268356303930343,
    ],
    "backlash": [
        0.4220792778261487,
        0.11090475910482608,
        -1.8467941388161506,
        -0.3068637298353121,
        -0.4242506206189125,
        -0.26487852342053886,
        1.6701236019825636,
        0.32708412539097464,
    ],
    "elasticity and friction": [
        0.43866584895164207,
        0.10150069693378731,
        -1.644934681250371,
        -0.33648102483401826,
        -0.40877448074184625,
        -0.27652141600702096,
        1.4025052146501462,
        0.33425294876995215,
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
