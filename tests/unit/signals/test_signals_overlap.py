"""Recordings that hold the same measurements are told, under whatever name and stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.api.objections.overlap import same_measurements, shared_share, shared_stamps

T = 0.01 * np.arange(600)


def wave(seed: int, step: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    signal = np.sin(3.0 * T + rng.uniform(0.0, 6.0)) + 0.3 * np.sin(7.0 * T + rng.uniform(0.0, 6.0))
    signal += 1e-4 * rng.standard_normal(len(T))
    return signal if step == 0.0 else step * np.round(signal / step)


def part(recording, rows: slice):
    return replace(recording, stamp_ns=recording.stamp_ns[rows], position=recording.position[rows])


def test_a_copy_with_other_stamps_and_joints_in_another_order_is_the_same(make):
    both = np.stack([wave(0), wave(1)], axis=1)
    one = make(T, both)
    turned = replace(one, joint_names=("b", "a"), position=both[:, ::-1])
    turned = replace(turned, stamp_ns=one.stamp_ns + 10**12, name="other")
    assert shared_share(one, turned) == 1.0
    assert same_measurements(one, turned).startswith("100 % of the motion is the same")


def test_conversions_to_degrees_and_back_hide_no_copy(make):
    one = make(T, wave(0))
    there_and_back = np.radians(np.degrees(one.position))
    assert shared_share(one, replace(one, position=there_and_back)) == 1.0


def test_a_part_of_a_recording_is_the_same(make):
    one = make(T, wave(0))
    assert shared_share(one, part(one, slice(200, 400))) == 1.0


def test_pieces_that_overlap_are_told_by_their_stamps(make):
    one = make(T, wave(0))
    first, second = part(one, slice(0, 350)), part(one, slice(300, 600))
    assert shared_stamps(first, second) == 49
    assert same_measurements(first, second) == (
        "49 measurements of the motion have the same stamps and values"
    )


def test_pieces_that_do_not_overlap_are_different(make):
    one = make(T, wave(0))
    assert same_measurements(part(one, slice(0, 300)), part(one, slice(300, 600))) == ""


@pytest.mark.parametrize("step", [1e-5, 1.5e-3])
@pytest.mark.parametrize("later_s", [0.0, 1.0])
def test_two_runs_of_the_same_motion_are_different(make, step, later_s):
    noise = 3e-3 * np.random.default_rng(7).standard_normal(len(T))
    again = step * np.round((wave(0) + noise) / step)
    one, two = make(T, wave(0, step)), make(T + later_s, again)
    assert same_measurements(one, two) == ""


def test_clocks_that_start_with_the_recording_do_not_make_two_the_same(make):
    begin = np.concatenate([wave(0)[:30], wave(1)[30:]])
    assert same_measurements(make(T, wave(0)), make(T, begin)) == ""


def test_the_same_rest_in_two_recordings_is_no_overlap(make):
    still = np.full(300, 0.25)
    one = make(T, np.concatenate([still, wave(0)[:300]]))
    two = make(T, np.concatenate([still, wave(1)[:300]]))
    assert same_measurements(one, two) == ""
