"""What is drawn of long series, and the words below it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gfm.diagnosis.output.result import EvidencePlot, Series
from gfm.report.figures import (
    PAGE_POINTS,
    SERIES_POINTS,
    compact,
    evidence_picture,
    joint_error_picture,
    kept_samples,
    points_per_series,
)
from gfm.report.words import duration, look_for, number, quantity, times


def plot_of(effect, x_label, *styles):
    series = tuple(
        Series(label=style, x=np.arange(9.0), y=np.arange(9.0), style=style) for style in styles
    )
    return EvidencePlot(
        title="t", effect=effect, joint="j", x_label=x_label, y_label="N m", series=series
    )


def test_a_short_series_is_kept_whole():
    assert kept_samples(np.arange(10.0), "line", 10).tolist() == list(range(10))


def test_a_line_keeps_a_peak_of_one_sample():
    y = np.zeros(100_000)
    y[54_321] = 1.0
    y[12_345] = -1.0
    kept = kept_samples(y, "line", 500)
    assert {0, 12_345, 54_321, 99_999} <= set(kept.tolist())


@given(
    samples=st.integers(1, 5000),
    limit=st.integers(4, 600),
    style=st.sampled_from(["line", "points"]),
    seed=st.integers(0, 9),
)
def test_what_is_kept_is_in_order_unique_and_within_the_limit(samples, limit, style, seed):
    y = np.random.default_rng(seed).normal(size=samples)
    y[y > 1.0] = np.nan
    kept = kept_samples(y, style, limit)
    assert len(kept) <= max(limit, 4)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == samples - 1


def test_a_page_never_draws_more_than_its_points():
    assert points_per_series(0) == points_per_series(1) == SERIES_POINTS
    assert 100 * points_per_series(100) <= PAGE_POINTS


def test_single_precision_is_used_where_it_cannot_be_seen():
    assert compact(np.linspace(0.0, 60.0, 100)).dtype == np.float32


def test_a_small_motion_on_a_large_value_stays_in_double_precision():
    stamps = 1.7e9 + np.linspace(0.0, 10.0, 100)
    assert np.array_equal(compact(stamps), stamps)


def test_infinity_becomes_a_gap():
    assert np.isnan(compact(np.array([0.0, np.inf, 1.0]))[1])
    assert np.isnan(compact(np.full(3, np.nan))).all()


def test_points_are_drawn_below_the_law_whatever_their_order():
    figure = evidence_picture(plot_of("", "x", "line", "points"), 100).figure
    assert [one.mode for one in figure.data] == ["markers", "lines"]


def test_a_single_point_on_a_line_is_a_mark_above_it():
    plot = plot_of("", "x", "points", "line")
    single = replace(plot.series[0], x=np.ones(1), y=np.ones(1))
    figure = evidence_picture(replace(plot, series=(single, plot.series[1])), 100).figure
    assert [one.mode for one in figure.data] == ["lines", "markers"]
    assert figure.data[1].marker.size > 8

    two = replace(plot, series=(single, replace(single, label="after")))
    before, after = evidence_picture(two, 100).figure.data
    assert before.marker.color != after.marker.color


def test_errors_that_a_logarithm_cannot_show_are_left_out(diagnosis_with):
    joint = replace(diagnosis_with().joints["right_j0"], before=float("nan"), after=0.0)
    figure = joint_error_picture({"j": joint}, "rad").figure
    assert [one.x for one in figure.data] == [(None,), (None,), (joint.noise_floor,)]


@pytest.mark.parametrize(("before", "dtick"), [(2e-3, "D2"), (2e-2, 1)])
def test_ticks_of_many_decades_leave_room_for_their_labels(diagnosis_with, before, dtick):
    joint = replace(
        diagnosis_with().joints["right_j0"], before=before, after=1e-3, noise_floor=2e-4
    )
    assert joint_error_picture({"j": joint}, "rad").figure.layout.xaxis.dtick == dtick


def test_the_caption_says_what_the_effect_looks_like():
    assert "step at zero velocity" in look_for(
        plot_of("coulomb_friction", "velocity (rad/s)", "points", "line")
    )


@pytest.mark.parametrize(("effect", "x_label"), [("coulomb_friction", "time (s)"), ("ours", "x")])
def test_the_caption_does_not_describe_another_picture(effect, x_label):
    caption = look_for(plot_of(effect, x_label, "points", "line"))
    assert "step at zero" not in caption
    assert "follow the line" in caption


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.00213, "0.00213"),
        (0.5, "0.500"),
        (120.4, "120"),
        (-3.14159, "-3.14"),
        (12345.6, "12,346"),
        (1.2e-5, "1.20e-05"),
        (None, "–"),
        (float("nan"), "–"),
        (float("-inf"), "–"),
    ],
)
def test_numbers_have_three_digits(value, text):
    assert number(value) == text


def test_units_follow_numbers_and_pure_numbers_have_none():
    assert quantity(1.5, "N m") == "1.50 N m"
    assert quantity(12.0, "1") == "12.0"
    assert quantity(float("nan"), "rad") == "–"


def test_a_ratio_to_no_noise_floor_means_nothing():
    assert times(1.0, 0.0) == "–"
    assert times(3.0, 2.0) == "1.5 ×"


def test_durations_are_read_at_a_glance():
    assert [duration(s) for s in (4.25, 187.2, float("nan"))] == ["4.2 s", "3:07 min", "–"]
