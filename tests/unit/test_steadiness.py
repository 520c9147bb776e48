"""Whether parts of the data tell the same amounts: linear laws, exact and approximated."""

import numpy as np
import pytest

from gfm.diagnosis.inference.blocks import BLOCK_S, SegmentShape, blocks_of
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.steadiness import apart, bends

COUNT, BLOCK = 2400, 100
ONE = np.array([True])
IN_TURN = 0.4 + 2.0 * 0.2 / np.sqrt(COUNT // BLOCK)


def recorded(recordings, joints=1):
    """So many recordings that have 24 blocks together, each of them a segment."""
    owners = np.repeat(np.arange(recordings), COUNT // BLOCK // recordings).tolist()
    return blocks_of([SegmentShape(owner, BLOCK_S, 1, BLOCK) for owner in owners], joints)


def told(columns, measured, effect=ONE, recordings=4):
    """How far parts put an effect apart whose columns are fitted to what was measured."""
    amounts = np.linalg.lstsq(columns, measured, rcond=None)[0]
    left = measured - columns @ amounts
    response = columns[:, effect] @ amounts[effect]
    fitted = Fit(effects=(), jacobian=-columns, residual=left)
    return apart(fitted, recorded(recordings), effect, response)


def speeds(seed=0):
    """A signal that is weak in some blocks and strong in others, shape (N, 1)."""
    rng = np.random.default_rng(seed)
    size = np.repeat(rng.uniform(0.3, 3.0, COUNT // BLOCK), BLOCK)
    return (size * rng.standard_normal(COUNT))[:, None]


def noise(seed, size=0.1):
    return size * np.random.default_rng(100 + seed).standard_normal(COUNT)


def test_a_law_that_holds_differs_by_chance_only():
    """By two standard errors of its amount: blocks are alike."""
    shares = [told(x := speeds(seed), 2.0 * x[:, 0] + noise(seed)) for seed in range(30)]
    errors = [0.1 / np.linalg.norm(2.0 * speeds(seed)) for seed in range(30)]
    assert max(shares) < 0.02
    assert np.median(np.array(shares) / errors) == pytest.approx(2.0, abs=0.2)


def test_a_law_that_holds_may_differ_the_more_the_less_the_data_tell():
    x = speeds()
    shares = [told(x, 2.0 * x[:, 0] + noise(0, size)) for size in (0.1, 1.0, 10.0)]
    assert shares[1] == pytest.approx(10.0 * shares[0], rel=0.1)
    assert shares[2] == pytest.approx(100.0 * shares[0], rel=0.3)


def test_a_law_of_another_form_differs_between_small_motions_and_large_ones():
    """Friction with the root of the speed as a straight line: 0.6 of it and 1.7 of it."""
    x = speeds()
    assert told(x, np.sign(x[:, 0]) * np.sqrt(np.abs(x[:, 0])) + noise(0)) > 0.3


def test_what_fades_differs_between_early_and_late():
    x = speeds()
    fading = np.tile(np.linspace(1.0, 0.4, 6 * BLOCK), 4)
    late_to_early = told(x, fading * x[:, 0] + noise(0))
    assert 0.3 < late_to_early < 0.7  # means of 0.85 and 0.55, 0.43 of the common 0.7
    assert told(x, 0.7 * x[:, 0] + noise(0)) < 0.02


def test_recordings_that_tell_other_amounts_differ_by_as_much():
    """1.2 and 0.8 of 1.0, and two standard errors of what blocks tell."""
    x = np.random.default_rng(0).standard_normal((COUNT, 1))
    amount = np.repeat([1.2, 0.8, 1.2, 0.8], COUNT // 4)
    assert told(x, amount * x[:, 0] + noise(0, 0.01)) == pytest.approx(IN_TURN, abs=0.03)


def test_blocks_take_turns_where_there_is_one_recording():
    x = np.random.default_rng(0).standard_normal((COUNT, 1))
    amount = np.repeat(np.tile([1.2, 0.8], COUNT // BLOCK // 2), BLOCK)
    share = told(x, amount * x[:, 0] + noise(0, 0.01), recordings=1)
    assert share == pytest.approx(IN_TURN, abs=0.03)


def test_a_part_that_tells_nothing_of_an_effect_does_not_contradict():
    """Something is touched in one recording only."""
    x = np.random.default_rng(0).standard_normal((COUNT, 1))
    x[COUNT // 4 :] = 0.0
    assert told(x, 2.0 * x[:, 0] + noise(0)) < 0.02


def test_a_part_that_tells_little_of_an_effect_hardly_ever_contradicts():
    """By chance, what it would say is another amount, and no clear one."""
    shares = []
    for seed in range(40):
        x = np.random.default_rng(seed).standard_normal((COUNT, 1))
        x[np.arange(COUNT) // BLOCK % 2 == 0] *= 0.01
        shares.append(told(x, 2.0 * x[:, 0] + noise(seed, 1.0)))
    assert np.mean(np.array(shares) > 0.1) <= 0.05


def test_one_effect_is_told_beside_another_that_does_not_hold():
    rng = np.random.default_rng(0)
    x = np.stack([speeds()[:, 0], rng.standard_normal(COUNT)], axis=1)
    fading = np.tile(np.linspace(1.0, 0.4, 6 * BLOCK), 4)
    measured = 2.0 * x[:, 0] + fading * x[:, 1] + noise(0)
    holds, fades = np.eye(2, dtype=bool)
    assert told(x, measured, holds) < 0.05
    assert told(x, measured, fades) > 0.3


def bent_by(law, effect, other=0.0, seed=0):
    """How much of what is left of a law an effect explains that should bend with its signal."""
    x = speeds(seed)
    column, measured = effect(x), law(x)[:, 0] + other + noise(seed)
    amount = np.linalg.lstsq(column, measured, rcond=None)[0]
    size = np.abs(x) / np.abs(x).max()
    ways = -column * amount * np.concatenate([size, size**2], axis=1)
    fitted = Fit(effects=(), jacobian=-column, residual=measured - column @ amount)
    return bends(fitted, ways, recorded(4), 0)


def test_a_law_that_holds_bends_by_chance_only():
    shares = [bent_by(lambda x: 2.0 * x, lambda x: x, seed=seed) for seed in range(30)]
    assert max(shares) < 0.01
    assert np.median(shares) < 1e-3


def test_what_a_law_of_another_form_misses_is_what_it_does_bent():
    assert bent_by(lambda x: x + 0.1 * x**3, lambda x: x) > 0.95
    assert bent_by(lambda x: np.sign(x) * np.sqrt(np.abs(x)), lambda x: x) > 0.5


def test_what_a_law_has_nothing_to_do_with_does_not_speak_against_it():
    other = np.sin(np.arange(COUNT))
    assert bent_by(lambda x: 2.0 * x, lambda x: x, other) < 0.02
    half = bent_by(lambda x: x + 0.1 * x**3, lambda x: x, 3.0 * other)
    assert 0.1 < half < 0.9


def test_a_bend_that_other_amounts_make_up_for_is_none():
    """A law that is its own bend, as one term of two, has nothing more to bend."""
    x = speeds()
    column, measured = np.concatenate([x, x * np.abs(x)], axis=1), (x + np.abs(x) * x)[:, 0]
    fitted = Fit(effects=(), jacobian=-column, residual=0.1 * measured)
    assert bends(fitted, -column[:, 1:], recorded(4), 0) == pytest.approx(0.0, abs=1e-6)


def bent_beside(left_on_others):
    """A law that should bend on the first of some joints; others leave so much, in noises."""
    x = speeds()
    column, measured = np.sign(x) * np.sqrt(np.abs(x)), x[:, 0]
    column *= measured @ column[:, 0] / (column[:, 0] @ column[:, 0])
    scale = 3.0 / np.sqrt(np.mean((measured - column[:, 0]) ** 2))
    left = np.stack(
        [
            scale * (measured - column[:, 0]),
            *(n * noise(k, 1.0) for k, n in enumerate(left_on_others)),
        ],
        axis=1,
    )
    alone = np.eye(1, len(left.T))
    fitted = Fit(effects=(), jacobian=-np.kron(scale * column, alone.T), residual=left.ravel())
    ways = -np.kron(scale * column * np.abs(x) / np.abs(x).max(), alone.T)
    return bends(fitted, ways, recorded(4, len(left.T)), 0)


def test_a_bend_counts_as_far_as_more_is_left_than_on_other_joints():
    """Three noises are left on the joint: nine in squares, and eight of them beyond noise."""
    alone = bent_beside(())
    assert alone > 0.8
    assert bent_beside((1.0, 1.0, 1.0)) == pytest.approx(alone, rel=0.01)
    assert bent_beside((2.0, 2.0, 2.0)) == pytest.approx(alone * (1.0 - 3.0 / 9.0), rel=0.03)
    assert bent_beside((4.0, 4.0, 4.0)) == 0.0


def test_one_other_joint_may_be_where_the_same_error_arrives():
    alone = bent_beside(())
    assert bent_beside((5.0,)) == pytest.approx(alone)
    assert bent_beside((5.0, 1.0, 1.0)) == pytest.approx(alone, rel=0.01)
