"""A corrected model is read again: a claim that is not in it is an error."""

from __future__ import annotations

import re

import mujoco
import pytest

from gfm.diagnosis.output import correction
from gfm.diagnosis.output.result import NamedEffect, ParameterEstimate
from gfm.effects import EffectInstance, find_effect
from gfm.sim.plant import native_spec
from gfm.sim.read_back import FIELDS, NotAppliedError, check_claims, check_read_back

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody><body>
    <joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
    <body pos="0 0 -0.3">
      <joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/>
    </body>
  </body></worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="20" kv="1"/>
    <position name="elbow" joint="elbow" kp="20" kv="1"/>
  </actuator>
</mujoco>
"""
AMOUNTS = {
    "armature": {"inertia": 0.02},
    "coulomb_friction": {"torque": 0.3},
    "viscous_friction": {"coefficient": 0.4},
    "actuator_gain": {"scale": 0.8},
    "command_delay": {"delay": 0.02},
    "encoder_offset": {"offset": 0.03},
    "torque_saturation": {"limit": 1.0},
    "backlash": {"gap": 0.01},
    "payload": {"mass": 0.5, "com_x": 0.0, "com_y": 0.01, "com_z": 0.1},
    "gravity_direction": {"tilt_x": 0.02, "tilt_y": -0.01},
}
JOINTS = {"payload": ("elbow",), "gravity_direction": ()}


def claim(name: str) -> NamedEffect:
    units = {one.name: one.unit for one in find_effect(name).parameters}
    return NamedEffect(
        effect=name,
        joints=JOINTS.get(name, ("shoulder",)),
        parameters={
            what: ParameterEstimate(value=value, unit=units[what], ci95=None)
            for what, value in AMOUNTS[name].items()
        },
        confidence=0.9,
        native=True,
    )


def instance(name: str) -> EffectInstance:
    return claim(name).instance()


def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(ARM)


@pytest.mark.parametrize("name", AMOUNTS)
def test_what_is_claimed_is_in_the_file(name: str) -> None:
    pair = correction.corrected_model(spec(), [claim(name)])
    check_read_back(pair.xml, mujoco.MjModel.from_xml_string(pair.xml))


def test_all_claims_together_are_in_the_file() -> None:
    together = [claim(name) for name in AMOUNTS]
    assert correction.corrected_model(spec(), together).xml


@pytest.mark.parametrize(
    ("lost", "field"),
    [
        ("armature", "dof_armature"),
        ("frictionloss", "dof_frictionloss"),
        ("damping", "dof_damping"),
    ],
)
def test_an_attribute_that_is_lost_on_the_way_is_an_error(
    lost: str, field: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = [claim(name) for name in ("armature", "coulomb_friction", "viscous_friction")]
    written = correction._corrected_xml
    monkeypatch.setattr(
        correction, "_corrected_xml", lambda *given: re.sub(f' {lost}="[^"]*"', "", written(*given))
    )
    with pytest.raises(NotAppliedError, match=rf"{field}\[0.*\] is 0, expected"):
        correction.corrected_model(spec(), named)


def test_a_claim_that_changes_nothing_is_an_error() -> None:
    slack = EffectInstance(
        effect=find_effect("coulomb_friction"), joints=("elbow",), values={"torque": 0.0}
    )
    with pytest.raises(NotAppliedError, match="coulomb_friction on elbow changes nothing"):
        check_claims(spec(), [instance("armature"), slack])


def test_a_joint_too_many_is_an_error_of_its_shape() -> None:
    meant = native_spec(spec(), [instance("backlash")]).compile()
    with pytest.raises(NotAppliedError, match=r"dof_armature has shape \(2,\), expected \(3,\)"):
        check_read_back(ARM, meant)


def test_every_field_is_one_of_mujocos() -> None:
    assert len(set(FIELDS)) == len(FIELDS)
    model = spec().compile()
    for name in FIELDS:
        owner = model.opt if name.startswith("opt.") else model
        assert hasattr(owner, name.removeprefix("opt."))
