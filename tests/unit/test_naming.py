"""Which of two names a constant torque gets, and that the amount is the same torque."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.search.naming import fitly_named, twin_of, twins
from gfm.effects import EffectInstance, effect_library

ROD = """
<mujoco>
  <worldbody>
    <body>
      <joint name="joint" axis="0 1 0" frictionloss="{level}"/>
      <geom size="0.1" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="joint" joint="joint"/></actuator>
</mujoco>
"""


def instance(name, **values):
    return EffectInstance(effect=effect_library()[name], joints=("joint",), values=values)


def named(*effects, level=0.0):
    specs = {CommandKind.EFFORT: mujoco.MjSpec.from_string(ROD.format(level=level))}
    parameters = sum(len(e.values) for e in effects)
    jacobian = np.arange(1.0, 3.0 * parameters + 1.0).reshape(3, parameters)
    fit = Fit(effects=effects, jacobian=jacobian, residual=np.zeros(3))
    return fit, fitly_named(fit, specs)


def test_a_torque_on_a_joint_without_friction_is_an_offset():
    _, after = named(instance("torque_offset", torque=0.3))
    assert [e.effect.name for e in after.effects] == ["torque_offset"]


@pytest.mark.parametrize(("level", "found"), [(0.5, ()), (0.0, (0.5,))])
def test_a_torque_on_a_joint_with_more_friction_is_asymmetric_friction(level, found):
    friction = [instance("coulomb_friction", torque=torque) for torque in found]
    before, after = named(*friction, instance("torque_offset", torque=0.3), level=level)
    assert after.effects[-1].effect.name == "asymmetric_friction"
    assert after.effects[-1].values == {"difference": pytest.approx(-0.6)}
    np.testing.assert_allclose(after.jacobian[:, -1], -0.5 * before.jacobian[:, -1])
    np.testing.assert_array_equal(after.jacobian[:, :-1], before.jacobian[:, :-1])


def test_a_torque_beyond_the_friction_cannot_be_friction():
    _, after = named(instance("torque_offset", torque=-0.3), level=0.2)
    assert after.effects[-1].effect.name == "torque_offset"


def test_the_other_name_of_the_other_name_is_the_same_effect():
    offset = instance("torque_offset", torque=0.3)
    assert twin_of(twin_of(offset)) == offset
    assert twins(offset, instance("coulomb_friction", torque=1.0)) == [twin_of(offset)]
