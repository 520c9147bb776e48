"""How reports are judged, which cases there are, and that their files are what a user has."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from known_truth import generate as generation
from known_truth import page
from known_truth.draft import LEAST_SIGNAL, draft
from known_truth.outside import SLIPPING, STRANGE
from known_truth.plans import VOCABULARY, Plan, plans
from known_truth.score import Score, relative_error, score
from known_truth.simulation import simulate
from known_truth.sizes import DRAWS

from gfm.api.models import load_specs
from gfm.api.recordings import check_together, read_recordings
from gfm.core import CommandKind
from gfm.effects import effect_library


def effect(name: str, *joints: str, **parameters: float) -> dict[str, object]:
    return {
        "effect": name,
        "joints": list(joints),
        "parameters": parameters,
        "equals": [],
        "unseen": [],
    }


def named(name: str, *joints: str, confidence: float = 0.9, **parameters: float):
    told = {
        key: {"value": value, "unit": "", "ci95": [value - 0.1, value + 0.1]}
        for key, value in parameters.items()
    }
    return {
        "effect": name,
        "joints": list(joints),
        "parameters": told,
        "confidence": confidence,
    }


def judged(
    hidden: list, found: list, suspects: tuple = (), category: str = "single", after: float = 1.0
) -> Score:
    truth = {"name": "case", "setup": "planar", "category": category, "effects": hidden}
    error = {"before": 2.0, "after": after, "noise_floor": 1.0}
    report = {"effects": found, "suspects": list(suspects), "verdict": "explained", "error": error}
    return score(truth, report, 3.0)


def test_a_right_name_in_the_right_place_is_right() -> None:
    one = judged(
        [effect("coulomb_friction", "elbow", torque=1.0)],
        [named("coulomb_friction", "elbow", torque=1.05)],
    )
    assert one.effect
    assert one.joint
    assert one.complete
    assert one.surplus == 0
    assert one.errors == (pytest.approx(0.05),)
    assert one.covered == (True,)
    assert not page.is_wrong(one)


def test_a_right_name_that_leaves_much_unexplained_is_listed() -> None:
    hidden, found = effect("backlash", "elbow", gap=0.1), named("backlash", "elbow", gap=0.2)
    one = judged([hidden], [found], after=1.6)
    assert one.complete
    assert page.is_wrong(one)
    assert not page.is_wrong(judged([hidden], [found], after=1.4))


def test_a_right_name_in_the_wrong_place_is_not() -> None:
    one = judged([effect("coulomb_friction", "elbow")], [named("coulomb_friction", "shoulder")])
    assert one.effect
    assert not one.joint
    assert not one.complete
    assert one.claimed
    assert page.is_wrong(one)


def test_what_comes_second_does_not_make_the_first_right() -> None:
    hidden = [effect("backlash", "elbow", gap=0.01)]
    one = judged(hidden, [named("armature", "elbow"), named("backlash", "elbow", gap=0.01)])
    assert not one.effect
    assert one.joint
    assert one.complete
    assert one.surplus == 1


def test_an_equal_counts_if_the_truth_is_listed_as_its_equal() -> None:
    hidden = effect("asymmetric_friction", "elbow", difference=0.2)
    hidden["equals"] = [{"effect": "torque_offset", "joints": ["elbow"]}]
    found = [named("torque_offset", "elbow", torque=-0.1)]
    told = {"effect": "asymmetric_friction", "joints": ["elbow"], "reason": "equal to it"}
    right = judged([hidden], found, (told,))
    assert right.effect
    assert right.joint
    assert right.complete
    assert right.errors == ()
    lost = told | {"reason": "explains only 3 %"}
    assert not judged([hidden], found, (lost,)).effect


def test_one_of_several_names_is_not_wrong_if_another_is_there_and_not_right_first() -> None:
    together = named("drive_dead_zone", "elbow")
    together["equals"] = [{"effect": "backlash", "joints": ["elbow"]}]
    for joint, surplus in (("elbow", 0), ("shoulder", 1)):
        told = judged([effect("backlash", joint)], [together])
        assert (told.surplus, told.claimed) == (surplus, bool(surplus))
        assert not told.effect
        assert not told.complete


def test_anything_named_on_clean_data_is_wrong() -> None:
    assert page.is_wrong(judged([], [named("armature", "elbow", confidence=0.1)], category="none"))
    assert not page.is_wrong(judged([], [], category="none"))


def test_a_hesitant_name_outside_the_vocabulary_is_not_claimed() -> None:
    hidden = [effect("cubic_spring", "elbow")]
    for confidence, wrong in ((0.4, False), (0.6, True)):
        found = [named("joint_spring", "elbow", confidence=confidence)]
        assert judged(hidden, found, category="outside").claimed is wrong


def test_beside_what_has_no_name_the_other_has_to_be_named() -> None:
    hidden = [effect("armature", "elbow", inertia=0.1), effect("cubic_spring", "elbow")]
    right, wrong = named("armature", "elbow", inertia=0.3), named("joint_spring", "elbow")
    right["parameters"]["inertia"] |= {"ci95": None, "spread": 0.15}
    one = judged(hidden, [right], category="beside")
    assert one.complete
    assert not one.claimed
    assert one.covered == ()
    assert one.spread == (False,)
    assert not judged(hidden, [wrong], category="beside").complete
    assert judged(hidden, [right, wrong], category="beside").claimed


def test_both_of_two_have_to_be_named() -> None:
    hidden = [effect("coulomb_friction", "elbow"), effect("coulomb_friction", "shoulder")]
    one, other = named("coulomb_friction", "elbow"), named("coulomb_friction", "shoulder")
    assert judged(hidden, [one, other], category="pair").complete
    assert not judged(hidden, [one], category="pair").complete
    assert page.is_wrong(judged(hidden, [one], category="pair"))


def test_errors_are_relative_to_what_a_parameter_is() -> None:
    assert relative_error("torque", 1.1, {"torque": 1.0}) == pytest.approx(0.1)
    assert relative_error("phase", 3.1, {"phase": -3.1}) == pytest.approx(2 * np.pi - 6.2)
    com = {"com_x": 0.3, "com_y": 0.0, "com_z": 0.4}
    assert relative_error("com_y", 0.05, com) == pytest.approx(0.1)
    assert relative_error("rest_angle", 0.1, {"rest_angle": 0.0}) == pytest.approx(0.1)


def test_the_page_counts_what_went_wrong() -> None:
    right = judged([effect("backlash", "elbow", gap=0.1)], [named("backlash", "elbow", gap=0.1)])
    wrong = judged([effect("backlash", "elbow", gap=0.1)], [named("armature", "elbow")])
    text = page.summary([right, wrong])
    assert "| one effect: the right one first | 95 % | 1 of 2 (50 %) |" in text
    assert "1 of 2" in page.by_effect([right, wrong])


def test_there_are_enough_cases_of_every_kind() -> None:
    cases = plans()
    assert len(cases) >= 100
    assert len({p.name for p in cases}) == len({p.seed for p in cases}) == len(cases)
    count = Counter(p.category for p in cases)
    kinds = ("single", "pair", "none", "outside", "poor", "beside", "everywhere")
    assert min(count[kind] for kind in kinds) >= 10
    assert {p.effects[0] for p in cases if p.category == "single"} == set(VOCABULARY)
    assert {p.effects[0] for p in cases if p.category == "outside"} == {*STRANGE, SLIPPING}
    assert {e for p in cases for e in p.effects} <= set(DRAWS)


def test_the_vocabulary_is_that_of_the_library() -> None:
    objects = {"object_friction", "object_mass", "object_com", "object_damping"}
    # The simulated robots meet no surface; a pendulum that does is tested in test_stretches.py.
    # Delays of other places than the command's are tested in test_delays.py.
    places = {"servo_delay", "position_delay", "effort_delay", "clock_offset"}
    assert set(VOCABULARY) == set(effect_library()) - objects - places - {"surface_contact"}


def quick(name: str) -> Plan:
    """Returns a case of the suite with short recordings."""
    (plan,) = [p for p in plans() if p.name == name]
    return replace(plan, excitation="short")


def test_what_every_joint_has_is_hidden_once_on_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generation, "_TRIED_S", 0.5)
    monkeypatch.setattr(generation, "simulate", partial(simulate, settling_s=0.1))
    plan = next(p for p in plans() if p.name.startswith("planar_effort-everywhere"))
    generation.generate([replace(plan, excitation="short")], tmp_path)
    truth = json.loads((tmp_path / "truth" / f"{plan.name}.json").read_text())
    assert {one["effect"] for one in truth["effects"]} == {plan.effects[0]}
    assert sorted(one["joints"] for one in truth["effects"]) == [["elbow"], ["shoulder"]]


def test_a_case_is_what_a_user_would_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation, "_TRIED_S", 0.5)
    monkeypatch.setattr(generation, "simulate", partial(simulate, settling_s=0.1))
    plan = quick("pendulum_position-coulomb_friction")
    generation.generate([plan], tmp_path)
    case = tmp_path / "cases" / plan.name
    recordings = sorted(case.glob("*.mcap"))
    assert len(recordings) == 6
    specs = load_specs(sorted(case.glob("*.xml")))
    assert list(specs) == [CommandKind.POSITION]
    read = read_recordings(recordings)
    check_together(specs, list(zip(recordings, read, strict=True)))
    assert all(one.duration_s == pytest.approx(2.0, abs=0.01) for one in read)
    assert all(one.command_stamp_ns[0] < one.stamp_ns[0] for one in read)
    truth = json.loads((tmp_path / "truth" / f"{plan.name}.json").read_text())
    (hidden,) = truth["effects"]
    assert hidden["effect"] == "coulomb_friction"
    assert hidden["joints"] == ["hinge"]
    assert hidden["signal"] >= LEAST_SIGNAL
    assert not list(case.glob("*.json"))


def test_no_encoder_offset_is_hidden_where_nothing_tells_of_it() -> None:
    """Not about the vertical: gravity and motion look the same from wherever angles count."""
    (plan,) = [p for p in plans(3) if p.name == "spatial_both-encoder_offset"]
    drawn = draft(plan)
    still = np.zeros((1, len(drawn.robot.joints)))
    drawn.nominal = [SimpleNamespace(servo=still, effort=still)]
    assert drawn.robot.upright
    assert drawn.joints[0] == 0
    assert drawn.candidate().joints == (drawn.joints[1],)
    drawn.plan = replace(plan, effects=("armature",))
    assert drawn.candidate().joints == (0,)


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    plan = quick("pendulum_position-none_0")
    there = tmp_path / "truth" / f"{plan.name}.json"
    there.parent.mkdir()
    there.write_text("{}")
    generation.generate([plan], tmp_path)
    assert not (tmp_path / "cases").exists()


def test_of_another_hand_a_right_model_leaves_its_discrepancy() -> None:
    error = {"before": 20.0, "after": 6.0, "noise_floor": 1.0}
    report = {"effects": [], "suspects": [], "verdict": "no_gap", "error": error}
    truth = {"name": "case", "setup": "planar", "category": "none", "effects": []}
    assert score(truth, report, 1.0).floor == 1.0
    assert score(truth | {"discrepancy": {"asked": 3.0}}, report, 1.0).floor == pytest.approx(
        np.sqrt(10.0)
    )
