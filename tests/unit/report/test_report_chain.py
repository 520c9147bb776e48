"""The evidence chain as a reader gets it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from gfm.report import diagnosis_html, diagnosis_json
from gfm.report.chain_document import (
    CLEAN_ROBOTS,
    FALSE_ALARMS,
    amounts_sentence,
    energy_sentence,
    false_alarms_sentence,
    hundredths,
    largest_rate,
)
from gfm.report.findings import delays_found, doubts_found
from gfm.signals.energy import Dissipation
from gfm.signals.finding import EVERYWHERE, Finding

RESULTS = Path(__file__).parents[3] / "docs" / "results"
STEPS = (
    "1. Input",
    "2. Delays",
    "3 and 4. Noise floor",
    "5. Where it lies",
    "6. Candidates before two witnesses",
    "7. Where the search stopped",
    "8. Amounts",
    "9. Energy",
    "10. What explains it equally well",
    "11. What to record next",
)


def late(joint, value, *, doubtful=False):
    return Finding(
        recording=EVERYWHERE,
        joint=joint,
        what="answers position commands after",
        value=value,
        unit="ms",
        consequence="no delay as such",
        doubtful=doubtful,
    )


def test_the_steps_stand_in_the_order_in_which_they_are_asked(diagnosis_with):
    page = diagnosis_html(diagnosis_with())
    places = [page.index(step) for step in STEPS]
    assert places == sorted(places)
    assert page.index("What the model lacks") < places[0]
    assert places[-1] < page.index("What else was considered")


def test_a_page_shows_every_step_in_figures(diagnosis_with):
    page = diagnosis_html(diagnosis_with())
    for text in (
        "noise on 0 of 7 joints, what the corrected model leaves on 7",
        "the sign of the velocity (-0.97)",
        "70 / 20 / 10 %",
        "70 % at low speed",
        "both say the same",
        "Of 85 simulated robots",
        "2 of 4 amounts have an interval",
        "The balance is even",
        "equal: joint spring (right_j1)",
        "5400 ± 310",
        "The search ended because no candidate predicts clearly better.",
        "without drag",
        "intermittent (6 segments that stayed far off)",
        "Taken out again: drag: it predicts as well without.",
    ):
        assert text in page


def test_a_witness_that_contradicts_is_marked(diagnosis_with, chain_with):
    page = diagnosis_html(diagnosis_with(chain=chain_with(rival="joint spring on right_j1")))
    assert "⚠ the missing torque prefers another effect: joint spring on right_j1" in page


def test_the_document_has_the_chain(diagnosis_with):
    document = json.loads(json.dumps(diagnosis_json(diagnosis_with()), allow_nan=False))
    told = document["evidence"]
    assert told["adequacy"][0]["before"]["goes_with"] == "sign_of_velocity"
    assert told["adequacy"][0]["left"] == "noise"
    assert told["regions"][0]["concentrated"] == "70 % at low speed"
    assert told["domains"][0]["agreement"] == "agrees"
    assert told["domains"][1]["rollout_share"] is None
    first = told["stopping"]["steps"][0]
    assert (first["move"], first["gain"], first["error"]) == ("add", 5400.0, 310.0)
    assert (told["stopping"]["room"], told["stopping"]["room_error"]) == (2.5, 3.0)
    assert told["stopping"]["false_alarm_rate_at_most"] == pytest.approx(0.0346, abs=1e-4)
    assert told["energy"]["even"] is True
    assert told["confusable"][0]["alternatives"][0]["effect"] == "joint_spring"
    assert diagnosis_json(diagnosis_with(chain=None))["evidence"] is None


def test_lateness_is_told_once_for_all_joints():
    lines = delays_found([late("a", 96.0), late("b", 103.0)])
    assert lines == ["a, b: answers position commands after 96.0 … 103 ms: no delay as such"]
    assert doubts_found([late("a", 96.0), late("b", 103.0)]) == 0
    assert doubts_found([late("a", 96.0, doubtful=True), late("b", 103.0, doubtful=True)]) == 1


def test_it_is_said_why_amounts_have_no_interval(diagnosis_with):
    whole = diagnosis_with()
    assert (
        amounts_sentence(replace(whole, effects=())) == "There are no amounts: nothing was named."
    )
    bare = replace(whole.effects[0], parameters={})
    torque = replace(whole.effects[0].parameters["torque"], ci95=None)
    without = replace(bare, parameters={"torque": torque})
    assert "No 95 % interval is given" in amounts_sentence(replace(whole, effects=(without,)))


def test_a_friction_that_drives_is_called_impossible(chain_with):
    balance = chain_with().energy
    pushing = Dissipation(effect="coulomb_friction", joints=("a",), power_w=-0.4, only_takes=True)
    assert "which no friction can" in energy_sentence(replace(balance, named=(pushing,)))
    assert "not even" in energy_sentence(replace(balance, unexplained_w=-4.0))


def test_a_rate_of_false_alarms_is_no_better_than_the_cases_allow():
    words = false_alarms_sentence()
    assert "named something on 0" in words
    assert "up to 3.5 %" in words


def test_zero_has_no_sign():
    assert [hundredths(x) for x in (-0.001, 0.0, 0.126, -0.126)] == [
        "0.00",
        "0.00",
        "0.13",
        "-0.13",
    ]


def test_no_error_in_a_few_cases_leaves_a_rate_possible():
    assert largest_rate(0, 13) == pytest.approx(1.0 - 0.05 ** (1 / 13))
    assert largest_rate(13, 13) == 1.0
    assert largest_rate(1, 100) > largest_rate(0, 100)


def test_no_fewer_false_alarms_are_claimed_than_were_recorded():
    right = clean = 0
    for page in RESULTS.glob("known_truth*.md"):
        found = re.search(r"none: nothing named .*?(\d+) of (\d+)", page.read_text())
        right, clean = right + int(found[1]), clean + int(found[2])
    runs = (RESULTS / "run_random_effects.md").read_text()
    quiet, driven = map(int, re.search(r"nothing named in\s+(\d+) of (\d+)", runs).groups())
    assert clean + driven >= CLEAN_ROBOTS
    recorded = largest_rate(clean + driven - right - quiet, clean + driven)
    assert recorded <= largest_rate(FALSE_ALARMS, CLEAN_ROBOTS)
