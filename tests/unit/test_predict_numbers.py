"""Predictions with effects that MuJoCo cannot express keep their numbers, digit by digit.

The figures were made by `figures` below with mujoco 4.0.0, before step laws and gravity
compensation had modules of their own (backlash after its motor side's microscopic mass was put on
the axis; friction that changes with the state after it was taken from the middle of a step; a motor
side since it begins under its load, and bears the compensation; torques since they are those of
the state at their instant; lags since they are exact; elasticity since a motor's friction has the
settings of its link's; dry friction since it holds as well as MuJoCo lets it). A diagnosis fits to
such numbers: they must not move unseen.
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
        0.41476480843565294,
        0.11649180911874449,
        -1.7260698700741925,
        -0.39876383636581403,
        -0.41332320805809675,
        -0.283930840101934,
        1.3886327731590562,
        0.3625754632008898,
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
        0.4264929448563487,
        0.10224531483010178,
        -1.8736947077863344,
        -0.3141768525890555,
        -0.42985812258617395,
        -0.2773806320633741,
        1.6863888729289411,
        0.3313587924611281,
    ],
    "tilt under compensation": [
        0.42602910268271305,
        0.10229124519637937,
        -5.2000832184853785,
        -0.7938388058416296,
        -0.4297177507722993,
        -0.2774011808890048,
        -1.2729690138544187,
        -0.041384249917520766,
    ],
    "backlash": [
        0.42207927782614846,
        0.11090475910482596,
        -1.8457797453286915,
        -0.3087878749718194,
        -0.4242506206189126,
        -0.26487852342053886,
        1.6689879978639937,
        0.32838517172667103,
    ],
    "elasticity and friction": [
        0.4386658489516419,
        0.10150069693378713,
        -1.646689305817068,
        -0.3388280624949343,
        -0.4087813044239576,
        -0.2765232167009932,
        1.4034277756943965,
        0.335915282216364,
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
