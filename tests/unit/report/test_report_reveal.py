"""The verdict against the sealed file."""

import pytest

from gfm.diagnosis.output.result import NamedEffect, ParameterEstimate
from gfm.report import HiddenEffect, HiddenParameter
from gfm.report.reveal import reveal


def named(effect, *joints, value=1.0, ci95=(0.9, 1.1)):
    estimate = ParameterEstimate(value=value, unit="N m", ci95=ci95)
    return NamedEffect(
        effect=effect, joints=joints, parameters={"torque": estimate}, confidence=0.9, native=True
    )


def hidden(effect, *joints, value=1.0):
    parameters = {"torque": HiddenParameter(value=value, unit="N m")}
    return HiddenEffect(effect=effect, joints=joints, parameters=parameters)


@pytest.mark.parametrize(
    ("verdict", "truth", "names_right", "joints_right"),
    [
        ([named("drag", "a")], [hidden("drag", "a")], True, True),
        ([named("drag", "b")], [hidden("drag", "a")], True, False),
        ([named("spring", "a")], [hidden("drag", "a")], False, False),
        ([named("drag", "a", "b")], [hidden("drag", "b", "a")], True, True),
        ([named("drag", "a"), named("spring", "a")], [hidden("drag", "a")], False, False),
        ([named("drag", "a"), named("drag", "b")], [hidden("drag", "a")], True, False),
        ([named("drag", "a")], [hidden("drag", "a"), hidden("spring", "b")], False, False),
        ([], [hidden("drag", "a")], False, False),
        ([named("drag", "a")], [], False, False),
        ([], [], True, True),
    ],
)
def test_names_and_joints_are_right_only_where_all_and_no_more_are_found(
    verdict, truth, names_right, joints_right
):
    result = reveal(verdict, truth)
    assert (result.names_right, result.joints_right) == (names_right, joints_right)


def test_surplus_effects_are_listed():
    result = reveal([named("drag", "a"), named("spring", "b")], [hidden("drag", "a")])
    assert [one.effect for one in result.surplus] == ["spring"]


@pytest.mark.parametrize(
    ("ci95", "inside"), [((0.9, 1.1), True), ((1.05, 1.1), False), (None, None)]
)
def test_the_interval_is_held_against_the_truth(ci95, inside):
    result = reveal([named("drag", "a", ci95=ci95)], [hidden("drag", "a")])
    assert result.checks[0].parameters[0].inside is inside


def test_an_effect_on_the_wrong_joint_lends_no_estimate():
    check = reveal([named("drag", "b")], [hidden("drag", "a")]).checks[0]
    assert check.parameters[0].estimate is None
    assert check.finding == "named, but elsewhere"
