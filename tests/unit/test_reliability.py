"""Whether confidences are what they say: what is collected, and how it is counted."""

import json
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import reliability
from known_truth.told import HALVES, Told, all_told, told_in


def told(confidence, right, *, suspect=False):
    return Told(
        case="case@0",
        effect="armature",
        confidence=confidence,
        right=right,
        suspect=suspect,
        evidence=None,
    )


def one(effect, *joints, **more):
    return {"effect": effect, "joints": list(joints), **more}


TRUTH = {
    "name": "case",
    "seed": 7,
    "effects": [
        one("armature", "elbow", equals=[]),
        one("torque_offset", "elbow", equals=[one("asymmetric_friction", "elbow")]),
    ],
}


def written(folder, effects, suspects=()):
    """Writes a case with its report, as the suite lays them out."""
    for file, content in (
        (folder / "truth" / "case.json", TRUTH),
        (
            folder / "diagnoses" / "case" / "report.json",
            {"effects": effects, "suspects": list(suspects)},
        ),
    ):
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps(content))
    return folder


def test_effects_and_suspects_with_a_confidence_are_collected(tmp_path):
    folder = written(
        tmp_path,
        [one("armature", "elbow", confidence=0.9, evidence={"bends": 0.1})],
        [
            one("armature", "shoulder", confidence=0.2, reason="explains less"),
            one("payload", "elbow", reason="explains less"),
        ],
    )
    names, reports = all_told([folder])
    assert reports == 1
    assert [(n.confidence, n.right, n.suspect) for n in names] == [
        (0.9, True, False),
        (0.2, False, True),
    ]
    assert names[0].case == "case@7"
    assert names[0].evidence == {"bends": 0.1}
    assert names[1].evidence is None


def test_an_equal_is_right_only_where_the_truth_stands_beside_it():
    named = one("asymmetric_friction", "elbow", confidence=0.8)
    equal = one("torque_offset", "elbow", reason="equal to it")
    for suspects, right in (([equal], True), ([], False)):
        (name,) = told_in(TRUTH, {"effects": [named], "suspects": suspects})
        assert name.right is right


def test_on_a_measured_robot_is_right_what_both_halves_bear_out(tmp_path):
    report = {
        "effects": [one("armature", "a", confidence=0.9), one("payload", "b", confidence=0.8)],
        "suspects": [
            one("backlash", "a", confidence=0.3),
            one("joint_spring", "a", confidence=0.1),
            one("viscous_friction", "a", reason="explains less"),
        ],
    }
    halves = [
        one("armature", "a", borne_out=True),
        one("payload", "b", borne_out=False),
        one("backlash", "a", borne_out=True),
    ]
    folder = tmp_path / "arm" / "diagnosis"
    folder.mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps(report))
    assert all_told([tmp_path]) == ([], 0)
    (folder / HALVES).write_text(json.dumps(halves))
    names, reports = all_told([tmp_path])
    assert reports == 1
    assert [(n.case, n.confidence, n.right, n.suspect) for n in names] == [
        ("arm", 0.9, True, False),
        ("arm", 0.8, False, False),
        ("arm", 0.3, True, True),
    ]


def test_confidences_fall_into_bins_and_certainty_into_the_last():
    bins = reliability.bins_of([told(0.0, False), told(0.1, True), told(0.95, True), told(1.0, 0)])
    assert [(b.low, b.count, b.right) for b in bins] == [(0.0, 1, 0), (0.1, 1, 1), (0.9, 2, 1)]
    assert bins[2].mean == pytest.approx(0.975)
    assert bins[2].share == 0.5


def test_a_tenth_falls_into_the_bin_that_it_begins():
    for tenth in range(10):
        (only,) = reliability.bins_of([told(tenth / 10, True)])
        assert only.low == tenth / 10


def test_what_is_right_as_often_as_it_says_has_no_calibration_error():
    names = [told(0.75, i % 4 > 0) for i in range(8)]
    assert reliability.calibration_error(reliability.bins_of(names)) == pytest.approx(0.0)


def test_the_calibration_error_weighs_bins_by_their_names():
    names = [told(0.9, False), *(told(0.5, True) for _ in range(3))]
    # A quarter is wrong by 0.9, three quarters by 0.5.
    assert reliability.calibration_error(reliability.bins_of(names)) == pytest.approx(0.6)
    assert reliability.calibration_error([]) == 0.0


def test_true_confidences_err_by_chance_less_with_more_names():
    few, many = ([told(0.7, True)] * count for count in (10, 1000))
    # The mean distance of a share from its expectation: sqrt(2 p (1 - p) / (pi n)).
    mean, upper = reliability.error_by_chance(many)
    assert mean == pytest.approx(np.sqrt(2 * 0.7 * 0.3 / (np.pi * 1000)), rel=0.1)
    assert upper == pytest.approx(1.96 * np.sqrt(0.7 * 0.3 / 1000), rel=0.15)
    assert reliability.error_by_chance(few)[0] > 5 * mean
    assert reliability.error_by_chance([told(1.0, True)]) == (0.0, 0.0)


def test_shares_have_wilsons_interval():
    assert reliability.wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert reliability.wilson(0, 10)[0] == 0.0
    assert reliability.wilson(10, 10)[1] == pytest.approx(1.0)


def test_figures_count_sure_names_and_wrong_claims():
    text = reliability.figures([told(0.95, True), told(0.9, False), told(0.6, 0), told(0.3, 0)])
    assert "| right, of those told with 0.9 to 1 | 1 of 2 (50 %) |" in text
    assert "| right, of those told with more than 0.5 | 1 of 3 (33 %) |" in text
    assert "| wrong names told with more than 0.5 | 2 of 3 (67 %) |" in text
    assert "| names | 4 |" in text


def test_nothing_told_is_said():
    assert "none told" in reliability.figures([])


def test_the_diagram_has_a_point_per_bin_and_perfection_on_the_diagonal():
    svg = reliability.diagram(reliability.bins_of([told(0.05, False), told(1.0, True)]))
    points = [e for e in ET.fromstring(svg).iter() if e.tag.endswith("circle")]
    assert len(points) == 2
    assert (points[1].get("cx"), points[1].get("cy")) == ("370.0", "10.0")


def test_page_and_diagram_are_written_side_by_side(tmp_path, monkeypatch, capsys):
    folder = written(tmp_path / "run", [one("armature", "elbow", confidence=0.9)])
    page = tmp_path / "page.md"
    monkeypatch.setattr(sys, "argv", ["reliability.py", str(folder), "--page", str(page)])
    reliability.main()
    text = page.read_text()
    assert "(page.svg)" in text
    assert "| 0.9-1.0 | 1 | 0.90 | 1.00 |" in text
    assert "## Suspects only" not in text
    assert (tmp_path / "page.svg").exists()
    assert text in capsys.readouterr().out


def test_confidences_of_today_are_made_of_the_evidence_in_the_reports():
    figures = {"z_without": 9.0, "z_rival": 0.0, "apart": 0.0, "bends": 0.0, "disagrees": 0.0}
    names = [replace(told(0.9, True), evidence=more) for more in (figures, None)]
    (tie,) = reliability.by_todays_weights(names)
    assert tie.suspect
    assert 0.49 < tie.confidence < 0.5
    (sure,) = reliability.by_todays_weights([replace(tie, evidence=figures | {"z_rival": 9.0})])
    assert not sure.suspect
