"""The top of a diagnosis's page: what to do next, bars, small pictures."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gfm.diagnosis.output.result import ErrorSummary, EvidencePlot, Series, Suspect, Verdict
from gfm.diagnosis.output.sentences import OUT_OF_TIME
from gfm.report.glance import bars, cards, next_steps, quiet_joints, small_picture

JOINTS = {
    "worst": ErrorSummary(before=0.08, after=0.02, noise_floor=0.001),
    "at_noise": ErrorSummary(before=0.001, after=0.001, noise_floor=0.001),
    "not_helped": ErrorSummary(before=0.04, after=0.04, noise_floor=0.001),
}


def drawn(x, y, style="points", label="measured"):
    return Series(label=label, x=np.asarray(x, float), y=np.asarray(y, float), style=style)


def plot_of(*series, title="torque"):
    return EvidencePlot(
        title=title, effect="coulomb_friction", joint="j", x_label="v", y_label="N m", series=series
    )


def test_bars_are_shares_of_the_longest_and_leave_out_joints_at_the_noise(diagnosis_with):
    diagnosis = diagnosis_with(joints=JOINTS)
    shown = {bar.joint: (bar.before, bar.after, bar.floor) for bar in bars(diagnosis)}
    assert shown["worst"] == pytest.approx((1.0, 0.25, 0.0125))
    assert shown["not_helped"] == pytest.approx((0.5, 0.5, 0.0125))
    assert quiet_joints(diagnosis) == ["at_noise"]


def test_a_model_without_a_gap_has_no_bars(diagnosis_with):
    diagnosis = diagnosis_with(joints={"one": JOINTS["at_noise"]})
    assert bars(diagnosis) == []
    assert quiet_joints(diagnosis) == ["one"]


def test_each_effect_has_the_picture_of_its_own_joint(diagnosis_with):
    diagnosis = diagnosis_with()
    shown = cards(diagnosis)
    assert [card.effect for card in shown] == list(diagnosis.effects)
    titles = [re.search("<title>(.*?)</title>", card.picture)[1] for card in shown]
    assert titles == [plot.title for plot in diagnosis.plots]
    without = cards(replace(diagnosis, plots=()))
    assert [str(card.picture) for card in without] == ["", ""]


def test_a_small_picture_fills_its_frame_and_draws_lines_above_points():
    line = drawn([0.0, 1.0], [-1.0, 1.0], style="line", label="fitted")
    picture = str(small_picture(plot_of(line, drawn([0.0, 1.0], [1.0, -1.0]))))
    assert 'd="M4.0 106.0L256.0 4.0"' in picture  # from the lower left corner to the upper right
    assert picture.index("M4.0 4.0h0M256.0 106.0h0") < picture.index("M4.0 106.0L")


def test_a_small_picture_leaves_out_what_is_no_number_and_escapes_titles():
    told = drawn([0.0, np.nan, 1.0], [0.0, 1.0, np.inf], style="line")
    picture = str(small_picture(plot_of(told, title="<b>")))
    assert "nan" not in picture
    assert "inf" not in picture
    assert "<title>&lt;b&gt;</title>" in picture
    assert str(small_picture(plot_of(drawn([np.nan], [0.0])))) == ""


@pytest.mark.parametrize(
    ("verdict", "effects", "first"),
    [
        (Verdict.EXPLAINED, True, "Use corrected.xml"),
        (Verdict.PARTLY_EXPLAINED, True, "Use corrected.xml"),
        (Verdict.NO_GAP, False, "Keep the model: these recordings show nothing"),
        (Verdict.UNEXPLAINED, False, "Keep the model for now"),
        (Verdict.INSUFFICIENT_DATA, False, "Record again"),
    ],
)
def test_every_verdict_says_first_what_to_do(diagnosis_with, verdict, effects, first):
    diagnosis = diagnosis_with(verdict=verdict, **({} if effects else {"effects": ()}))
    assert next_steps(diagnosis)[0].startswith(first)


def test_a_model_that_is_worse_on_held_out_recordings_is_not_recommended(diagnosis_with):
    worse = ErrorSummary(before=0.03, after=0.08, noise_floor=0.001)
    told = next_steps(diagnosis_with(verdict=Verdict.PARTLY_EXPLAINED, error=worse))
    assert told[0].startswith("Keep the model")


def test_what_stays_is_told_with_its_size_and_its_joint(diagnosis_with):
    diagnosis = diagnosis_with(
        verdict=Verdict.PARTLY_EXPLAINED,
        joints=JOINTS,
        error=ErrorSummary(before=0.05, after=0.026, noise_floor=0.001),
    )
    told = " ".join(next_steps(diagnosis))
    assert "0.0260 rad: 26.0 × the sensor noise, most of it on not_helped" in told


def test_doubts_name_the_motion_that_would_decide_once(diagnosis_with):
    doubtful = [
        Suspect(effect=name, joints=("j",), reason="", decided_by="slow reversals", confidence=sure)
        for name, sure in (("viscous_friction", 0.2), ("coulomb_friction", 0.4))
    ]
    told = next_steps(diagnosis_with(suspects=tuple(doubtful), notes=(OUT_OF_TIME,)))
    assert any("--minutes" in step for step in told)
    (step,) = [step for step in told if "slow reversals" in step]
    assert "slow reversals (coulomb friction (j), viscous friction (j))" in step
