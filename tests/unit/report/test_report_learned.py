"""What learned forces say, beside the verdict."""

import json
from dataclasses import replace

import pytest

from gfm.diagnosis.learned import JointForce, LearnedName, LearnedReport
from gfm.effects import EffectInstance, find_effect
from gfm.report import diagnosis_html, diagnosis_json
from gfm.report.learned_document import both_say, learned_sentence


def name(effect, joint, share=0.9, **values):
    instance = EffectInstance(effect=find_effect(effect), joints=(joint,), values=values)
    return LearnedName(instance=instance, share=share)


FRICTION = name("coulomb_friction", "right_j1", torque=1.28)
SPRING = name("joint_spring", "right_j2", stiffness=2.0, rest_angle=0.1)
HEARD = JointForce(joint="right_j1", rms_nm=1.2, of_drive=0.4, named=0.9)
QUIET = JointForce(joint="right_j0", rms_nm=0.01, of_drive=0.001, named=None)


def told(*names, joints=(HEARD, QUIET)):
    return LearnedReport(members=3, spread=0.12, names=names, joints=joints)


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ((FRICTION,), "the same that the recordings support"),
        ((FRICTION, SPRING), "some of them are those that the recordings support"),
        ((SPRING,), "the recordings support others"),
        ((), "No named effect explains what was learned"),
    ],
)
def test_it_is_said_whether_both_agree(diagnosis_with, names, says):
    whole = diagnosis_with(gfm=told(*names))
    whole = replace(whole, effects=whole.effects[:1])
    assert says in learned_sentence(whole)


def test_forces_that_are_too_small_say_nothing(diagnosis_with):
    assert "too small" in learned_sentence(diagnosis_with(gfm=told(joints=(QUIET,))))
    assert learned_sentence(diagnosis_with()) == ""


def test_amounts_stand_beside_each_other(diagnosis_with):
    whole = diagnosis_with(gfm=told(FRICTION))
    rows = both_say(replace(whole, effects=whole.effects[:1]))
    assert [(r.effect, r.learned, r.recordings) for r in rows] == [("coulomb_friction", 1.28, 1.32)]
    rows = both_say(replace(whole, effects=()))
    assert [(r.learned, r.recordings) for r in rows] == [(1.28, None)]
    assert both_say(diagnosis_with()) == []


def test_page_and_document_have_a_section_of_their_own(diagnosis_with):
    whole = diagnosis_with(gfm=told(FRICTION, SPRING))
    page = diagnosis_html(whole)
    for text in ("What the learned forces say", "1.28 N m", "too small to say", "3 fitted force"):
        assert text in page
    document = json.loads(json.dumps(diagnosis_json(whole), allow_nan=False))["gfm"]
    assert document["named_share"] == 0.9
    assert document["effects"][1]["parameters"]["stiffness"] == {"value": 2.0, "unit": "N m/rad"}
    assert document["joints"][1]["named"] is None
    assert diagnosis_json(diagnosis_with())["gfm"] is None
    assert "What the learned forces say" not in diagnosis_html(diagnosis_with())
