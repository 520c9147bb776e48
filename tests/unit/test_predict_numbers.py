"""Predictions with effects that MuJoCo cannot express keep their numbers, digit by digit.

The figures were made by `figures` below with mujoco 4.0.0, before step laws and gravity
compensation had modules of their own (backlash after its motor side's microscopic mass was put on
the axis). A diagnosis fits to such numbers: they must not move unseen.
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
        0.42199305820434685,
        0.100564518809304,
        -1.8415122178468604,
        -0.309798766835996,
        -0.42418003139108573,
        -0.27490080141502865,
        1.6655091994318454,
        0.32592921763729166,
    ],
    "load": [
        0.42176166447984786,
        0.10871566916380604,
        -1.841144720884433,
        -0.47802753536350684,
        -0.4236590174758769,
        -0.2813346897501221,
        1.6497236634462453,
        0.5087593977481308,
    ],
    "both at once": [
        0.4148105560044959,
        0.11646205166648385,
        -1.7305317683061197,
        -0.3990127030115128,
        -0.41340912892109183,
        -0.28395213679700576,
        1.3906412412155955,
        0.3629401353912934,
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
        0.42169847115694203,
        0.11080911830396405,
        -1.8779972639070763,
        -0.3134307563569189,
        -0.42484781768348756,
        -0.2852992189851312,
        1.6752256931751806,
        0.32735477693513015,
    ],
    "elasticity and friction": [
        0.4222557947192075,
        0.10113957896831316,
        -1.6951787059703527,
        -0.3463623186175789,
        -0.4241478749201879,
        -0.2764061953111382,
        1.3915096970993481,
        0.3317780550965832,
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
