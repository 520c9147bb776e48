"""What is known of the recordings' quality stands in both reports."""

from __future__ import annotations

import pytest

from gfm.excitation.blind_spots import BlindSpot
from gfm.report import diagnosis_html, diagnosis_json
from gfm.report.findings import finding_amount, gathered
from gfm.report.words import some
from gfm.signals.finding import Finding


def finding(**changes: object) -> Finding:
    values = {
        "recording": "one",
        "joint": "a",
        "what": "encoder step",
        "value": 1.5,
        "unit": "mrad",
        "consequence": "no smaller error can be seen",
        "doubtful": False,
    }
    return Finding(**values | changes)


def test_findings_that_say_the_same_become_one_row_doubtful_ones_first():
    rows = gathered(
        [
            finding(),
            finding(joint="b", value=3.0),
            finding(recording="two"),
            finding(what="longest gap", joint=None, doubtful=True),
        ]
    )
    assert [row.what for row in rows] == ["longest gap", "encoder step"]
    assert rows[1].joints == ("a", "b")
    assert rows[1].recordings == ("one", "two")
    assert (rows[1].low, rows[1].high) == (1.5, 3.0)
    assert rows[0].joints == ()


@pytest.mark.parametrize(
    ("findings", "words"),
    [
        ([finding()], "1.50 mrad"),
        ([finding(), finding(value=3.0)], "1.50 … 3.00 mrad"),
        ([finding(value=42.0, unit="ms", spread=0.7)], "42.0 ± 0.700 ms"),
        ([finding(value=9.55, unit="")], "9.55"),
    ],
)
def test_amounts_are_shown_with_their_spread_or_their_range(findings, words):
    (row,) = gathered(findings)
    assert finding_amount(row) == words


def test_long_lists_of_names_are_cut():
    assert some(["a", "b"]) == "a, b"
    assert some(list("abcdef")) == "a, b, c, d and 2 more"
    assert some([]) == "–"


def test_a_finding_in_words_names_joint_amount_and_consequence():
    assert finding(value=42.0, unit="ms", spread=0.7).words == (
        "a: encoder step 42 ± 0.7 ms (no smaller error can be seen)"
    )


def test_the_document_lists_every_finding(diagnosis_with):
    found = (finding(), finding(joint=None, spread=0.5, value=float("nan")))
    (first, second) = diagnosis_json(diagnosis_with(findings=found))["input_quality"]
    assert first == {
        "recording": "one",
        "joint": "a",
        "what": "encoder step",
        "value": 1.5,
        "unit": "mrad",
        "consequence": "no smaller error can be seen",
        "doubtful": False,
        "spread": None,
    }
    assert (second["joint"], second["value"], second["spread"]) == (None, None, 0.5)


def test_the_page_has_a_table_of_them_only_where_there_are_any(diagnosis_with):
    page = diagnosis_html(diagnosis_with(findings=(finding(what="<b>step</b>"),)))
    assert "Their quality" in page
    assert "&lt;b&gt;step&lt;/b&gt;" in page
    assert "Their quality" not in diagnosis_html(diagnosis_with(findings=()))


def test_what_could_not_be_seen_is_told_with_the_motion_that_shows_it(diagnosis_with):
    spot = BlindSpot(
        effect="cogging_torque",
        joints=("a",),
        why="a covers 0.1 rad; expected a whole period",
        motion="sweep: a slow way through the whole range",
    )
    told = diagnosis_with(blind_spots=(spot,))
    (said,) = diagnosis_json(told)["blind_spots"]
    assert (said["effect"], said["joints"]) == ("cogging_torque", ["a"])
    page = diagnosis_html(told)
    assert "could not have shown" in page
    assert spot.motion in page
    assert "could not have shown" not in diagnosis_html(diagnosis_with(blind_spots=()))
