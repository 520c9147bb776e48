"""The score by which hypotheses are compared, on residuals whose answer is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

from gfm.diagnosis.inference import blocks as division
from gfm.diagnosis.inference import constants
from gfm.diagnosis.inference.blocks import BLOCK_LEAST, OCTAVES_HZ, SegmentShape
from gfm.diagnosis.inference.constants import (
    CLEARLY,
    DEGREES_OF_FREEDOM,
    LEAST_DISCREPANCY,
    WRONG_ALIKE,
)
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.score import Difference, difference, effective, predictive, room
from one_joint import instance


@dataclass(frozen=True)
class Recorded:
    """Segments without a model: what a residual would belong to."""

    joints: tuple[str, ...]
    segments: tuple[SegmentShape, ...]

    @property
    def size(self):
        return sum(s.channels * s.measurements * len(self.joints) for s in self.segments)


def blocks_of(layout, **how):
    return division.blocks_of(layout.segments, len(layout.joints), **how)


def recorded(recordings=4, segments=3, joints=("a",), channels=1, measurements=400):
    """Segments of 2 s at most, one block each."""
    shape = {"duration_s": 2.0, "channels": channels, "measurements": measurements}
    rows = [SegmentShape(recording=r, **shape) for r in range(recordings) for _ in range(segments)]
    return Recorded(joints, tuple(rows))


#: A recording of torque commands beside one with efforts, and one that is too short to be cut.
MIXED = Recorded(
    ("a", "b"),
    (
        SegmentShape(recording=0, duration_s=6.0, channels=2, measurements=301),
        SegmentShape(recording=1, duration_s=0.5, channels=1, measurements=50),
        SegmentShape(recording=1, duration_s=7.0, channels=1, measurements=11),
    ),
)


def fitted(residual, columns=None):
    """The least-squares fit of columns to what would be left without them."""
    if columns is None:
        columns = np.zeros((len(residual), 0))
    amounts = np.linalg.lstsq(columns, residual, rcond=None)[0]
    left = residual - columns @ amounts
    return Fit(effects=(), jacobian=-columns, residual=left)


def gain(layout, residual, columns):
    """By how much columns that are fitted to a residual predict it better than nothing does."""
    blocks = blocks_of(layout)
    return difference(
        blocks, predictive(blocks, fitted(residual, columns)), predictive(blocks, fitted(residual))
    )


@pytest.mark.parametrize("layout", [recorded(), recorded(joints=("a", "b"), channels=2), MIXED])
def test_blocks_divide_every_number_exactly_once(layout):
    blocks = blocks_of(layout)
    rows = np.concatenate([piece.ravel() for piece in blocks.pieces])
    np.testing.assert_array_equal(np.sort(rows), np.arange(layout.size))
    assert blocks.count.sum() == layout.size
    for number, piece in enumerate(blocks.pieces):
        assert (blocks.block[piece] == number).all()
        assert len(np.unique(blocks.fold[piece])) == 1
        assert blocks.count[number].sum() == piece.size


def test_blocks_are_two_seconds_long_or_as_short_as_measurements_allow():
    lengths = [piece.shape[1] for piece in blocks_of(MIXED).pieces]
    assert lengths == [101, 100, 100, 50, 11]
    assert min(lengths) >= BLOCK_LEAST


def test_a_cell_is_one_channel_and_joint_in_one_octave():
    blocks, octaves = blocks_of(MIXED), len(OCTAVES_HZ)
    assert blocks.count.shape == (5, 2 * 2 * octaves)
    (first,) = (piece for piece in blocks.pieces if piece.shape[1] == 101)
    by_place = blocks.cell[first] // octaves
    assert by_place.min(axis=1).tolist() == by_place.max(axis=1).tolist() == [[0, 1], [2, 3]]
    whole = blocks.count.reshape(5, 4, octaves).sum(axis=2)
    np.testing.assert_array_equal(whole[0], [101.0] * 4)  # both channels
    np.testing.assert_array_equal(whole[3], [50.0, 50.0, 0.0, 0.0])  # positions alone


@pytest.mark.parametrize("hertz", [0.5, 1.5, 3.0, 6.0, 12.0, 40.0])
def test_what_swings_is_found_in_the_octave_of_its_frequency(hertz):
    layout = recorded(recordings=1, segments=1)
    blocks = blocks_of(layout)
    time_s = (np.arange(400) + 0.5) / 200.0
    power = blocks.sums(blocks.spectrum(np.cos(2.0 * np.pi * hertz * time_s)) ** 2)[0]
    assert np.argmax(power) == np.searchsorted(OCTAVES_HZ, hertz, side="right") - 1
    assert power.max() > 0.99 * power.sum()


def test_frequencies_have_the_power_of_the_residual_in_every_block():
    residual = np.random.default_rng(0).standard_normal(MIXED.size)
    blocks = blocks_of(MIXED)
    power = blocks.sums(blocks.spectrum(residual) ** 2).sum(axis=1)
    np.testing.assert_allclose(power, [np.sum(residual[p] ** 2) for p in blocks.pieces])


def test_parts_are_recordings_or_every_other_segment_of_one():
    several, one = blocks_of(recorded(3, 2)), blocks_of(recorded(1, 4))
    assert [int(several.fold[p][0, 0, 0]) for p in several.pieces] == [0, 0, 1, 1, 2, 2]
    assert [int(one.fold[p][0, 0, 0]) for p in one.pieces] == [0, 1, 0, 1]


def test_the_density_is_that_of_students_t():
    """All coefficients of a block's cell share one scale, that of the other blocks.

    Up to a constant: a multivariate t, held against that of nothing at all at a scale of one.
    """
    layout, freedom = recorded(recordings=5, segments=1, measurements=16), DEGREES_OF_FREEDOM
    rng = np.random.default_rng(1)
    residual = rng.standard_normal(layout.size) * np.repeat(rng.uniform(200.0, 900.0, 5), 16)
    blocks = blocks_of(layout)
    told, spectrum = predictive(blocks, fitted(residual)), blocks.spectrum(residual)
    for block, cell in ((0, 0), (2, 1), (4, 2)):
        here = [spectrum[(blocks.block == number) & (blocks.cell == cell)] for number in range(5)]
        count, own = len(here[block]), here.pop(block)
        squares = np.array([float(values @ values) for values in here])
        weights = (freedom + count) / (freedom + squares / told.scale[cell])
        scale = float(weights @ squares) / (4 * count)

        def density(values, scale, count=count):
            return stats.multivariate_t.logpdf(
                values, loc=np.zeros(count), shape=scale * np.eye(count), df=freedom
            )

        exact = density(own, scale) - density(np.zeros(count), 1.0)
        assert told.density[block, cell] == pytest.approx(exact, rel=1e-3)


def test_the_scale_is_the_most_likely_one():
    layout = recorded(recordings=40, segments=1)
    residual = 7.0 * np.random.default_rng(0).standard_normal(layout.size)
    blocks = blocks_of(layout)
    told = predictive(blocks, fitted(residual))
    square, number = told.mean_square, blocks.count

    def likelihood(scale):
        off = DEGREES_OF_FREEDOM + number
        return np.sum(
            -0.5 * number * np.log(scale)
            - 0.5 * off * np.log1p(number * square / (DEGREES_OF_FREEDOM * scale)),
            axis=0,
        )

    best = likelihood(told.scale)
    assert (best >= likelihood(1.05 * told.scale)).all()
    assert (best >= likelihood(told.scale / 1.05)).all()


def test_no_model_is_as_exact_as_the_sensors():
    """A residual smaller than what a right model leaves is as good as nothing at all."""
    blocks = blocks_of(recorded())
    small, none = (
        predictive(blocks, fitted(np.full(recorded().size, size))) for size in (1e-3, 0.0)
    )
    assert difference(blocks, none, small).nats == pytest.approx(0.0, abs=1e-9)
    # A right model may leave all of its discrepancy in one octave, which one is not known.
    power = (blocks.count * small.mean_square).sum(axis=1)
    np.testing.assert_allclose(power, 400.0 * (1.0 + len(OCTAVES_HZ) * LEAST_DISCREPANCY**2))


def test_a_hypothesis_differs_from_its_equal_by_nought():
    residual = 5.0 * np.random.default_rng(0).standard_normal(recorded().size)
    blocks = blocks_of(recorded())
    one, same = (predictive(blocks, fitted(residual)) for _ in range(2))
    told = difference(blocks, one, same)
    assert told.nats == 0.0
    assert told.error == pytest.approx(0.0, abs=1e-6)
    assert not told.clear


def test_a_difference_is_the_same_the_other_way_round_with_its_sign():
    rng = np.random.default_rng(0)
    blocks = blocks_of(recorded())
    one, other = (
        predictive(blocks, fitted(size * rng.standard_normal(recorded().size))) for size in (3, 9)
    )
    there, back = difference(blocks, one, other), difference(blocks, other, one)
    assert there.nats == pytest.approx(-back.nats)
    assert there.error == pytest.approx(back.error)
    assert there.nats > 0.0


def test_a_column_that_is_not_there_gains_nothing_on_white_noise():
    rng, layout = np.random.default_rng(0), recorded()
    gains = [
        gain(layout, rng.standard_normal(layout.size), rng.standard_normal((layout.size, 1)))
        for _ in range(100)
    ]
    assert np.mean([one.nats for one in gains]) <= 0.0
    assert not any(one.clear for one in gains)


def test_a_column_that_is_not_there_is_hardly_ever_clear_beside_a_discrepancy():
    """What a wrong model leaves is slow; a slow column that knows nothing of it predicts worse."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    time_s = np.tile((np.arange(400) + 0.5) / 200.0, 16)
    clear = []
    for _ in range(100):
        wrong, column = (
            np.sin(2.0 * np.pi * rng.uniform(0.3, 3.0) * time_s + np.repeat(phases, 400))
            for phases in rng.uniform(0.0, 6.0, (2, 16))
        )
        residual = 20.0 * wrong + rng.standard_normal(layout.size)
        clear.append(gain(layout, residual, column[:, None]).clear)
    assert np.mean(clear) <= 0.05


def test_a_planted_effect_is_clear():
    rng, layout = np.random.default_rng(0), recorded()
    column = np.sin(np.linspace(0.0, 90.0, layout.size))[:, None]
    residual = 30.0 * column[:, 0] + rng.standard_normal(layout.size)
    told = gain(layout, residual, column)
    assert told.clear
    assert told.nats > 20.0


def test_a_planted_effect_is_clear_beside_a_discrepancy_that_is_not_its():
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    time_s = np.tile((np.arange(400) + 0.5) / 200.0, 16)
    column = np.sin(2.0 * np.pi * time_s)[:, None]
    phases = np.repeat(rng.uniform(0.0, 6.0, 16), 400)
    wrong = 5.0 * np.sin(2.0 * np.pi * 1.4 * time_s + phases)
    residual = 40.0 * column[:, 0] + wrong + rng.standard_normal(layout.size)
    assert gain(layout, residual, column).clear


def test_what_one_recording_alone_tells_of_is_less_clear_than_what_all_do():
    rng, layout = np.random.default_rng(0), recorded()
    everywhere = np.sin(np.linspace(0.0, 80.0, layout.size))
    alone = np.where(np.arange(layout.size) < layout.size // 4, everywhere, 0.0)
    noise = rng.standard_normal(layout.size)
    one, all_ = (gain(layout, 30.0 * c + noise, c[:, None]) for c in (alone, everywhere))
    assert one.clear
    assert one.errors < 0.7 * all_.errors


@pytest.mark.parametrize("often", [0.5, 1.0, 3.0])
def test_what_acts_in_one_block_is_clear_only_where_it_brings_all_that_it_says(often):
    """Nothing else says anything of it. An accident is not: it has another course in time."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    time_s, clear = (np.arange(400) + 0.5) / 200.0, {True: 0, False: 0}
    for _ in range(100):
        acts, happens = (
            np.exp(-0.5 * ((time_s - at) / width) ** 2) * np.sin(2.0 * np.pi * often * time_s)
            for at, width in zip(rng.uniform(0.3, 1.7, 2), rng.uniform(0.1, 0.5, 2), strict=True)
        )
        column = np.zeros(layout.size)
        column[800:1200] = acts
        for right in clear:
            residual = rng.standard_normal(layout.size)
            residual[800:1200] += 300.0 * (acts if right else happens)
            clear[right] += gain(layout, residual, column[:, None]).clear
    assert clear[True] >= 95
    assert clear[False] <= 5


def test_what_a_few_blocks_leave_is_room():
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    blocks, noise = blocks_of(layout), rng.standard_normal(layout.size)
    noise[800:1200] += 100.0 * np.sin(np.linspace(0.0, 9.0, 400))
    assert room(blocks, predictive(blocks, fitted(noise))).clear


@pytest.mark.parametrize(("signs", "clear"), [((1, 1, 1, 1), True), ((1, -1, 1, -1), False)])
def test_what_acts_in_a_few_blocks_is_clear_where_recordings_confirm_each_other(signs, clear):
    """Each of four recordings says it once, the first much more than the others."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    size, each = layout.size, layout.size // 4
    column = np.zeros(size)
    for start, strength in zip(range(0, size, each), (1000.0, 20.0, 20.0, 20.0), strict=True):
        column[start : start + 400] = strength * np.sin(np.linspace(0.0, 12.0, 400))
    truth = column * np.repeat(signs, each)
    told = gain(layout, truth + rng.standard_normal(size), column[:, None])
    assert told.clear is clear


def test_leaving_a_part_out_by_the_jacobian_is_the_same_as_fitting_without_it():
    rng, layout = np.random.default_rng(0), recorded(measurements=40)
    columns = rng.standard_normal((layout.size, 3))
    residual = columns @ [2.0, -1.0, 0.5] + 3.0 * rng.standard_normal(layout.size)
    blocks = blocks_of(layout)
    exact = np.empty(layout.size)
    for part in range(4):
        rows = blocks.fold == part
        amounts = np.linalg.lstsq(columns[~rows], residual[~rows], rcond=None)[0]
        exact[rows] = residual[rows] - columns[rows] @ amounts
    told = predictive(blocks, fitted(residual, columns)).spectrum
    np.testing.assert_allclose(told, blocks.spectrum(exact), rtol=0.01, atol=0.02)


def test_what_one_part_alone_tells_stands_though_its_fit_ended_a_little_beside_the_best():
    """Other parts say nothing of the amount: nothing of it is to be had from them."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    column = np.zeros((layout.size, 1))
    column[400:800, 0] = rng.standard_normal(400)
    best = fitted(100.0 * column[:, 0] + rng.standard_normal(layout.size), column)
    beside = replace(best, residual=best.residual - 0.01 * column[:, 0])
    told = [predictive(blocks_of(layout), one).spectrum for one in (best, beside)]
    np.testing.assert_allclose(told[1], told[0], atol=0.1)


def test_a_score_leaves_the_fit_as_it_is():
    rng, layout = np.random.default_rng(0), recorded()
    found = fitted(rng.standard_normal(layout.size), rng.standard_normal((layout.size, 2)))
    before = found.residual.copy()
    once, again = (predictive(blocks_of(layout), found) for _ in range(2))
    np.testing.assert_array_equal(found.residual, before)
    np.testing.assert_array_equal(once.density, again.density)


def test_what_acts_now_and_then_is_not_blamed_on_what_acts_always():
    """Other recordings know nothing of it: what they would make of its amounts judges nobody."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=4)
    rare, always = instance("surface_contact"), instance("coulomb_friction", torque=1.0)
    rows, waves = np.arange(layout.size), np.sin(np.linspace(0.0, 90.0, layout.size))
    touching = np.where(rows[:, None] < 800, rng.standard_normal((layout.size, 5)), 0.0)
    columns = np.column_stack([touching, waves])
    residual = 30.0 * waves + 50.0 * touching[:, 0] + 5.0 * rng.standard_normal(layout.size)
    found = replace(fitted(residual, columns), effects=(rare, always))
    # A fit ends a little beside the best: elsewhere, that leaves the amounts of the table open.
    found = replace(found, residual=found.residual + 0.1 * touching.sum(axis=1))
    without = replace(found, effects=(rare,), jacobian=-touching, residual=residual)
    blocks = blocks_of(layout)
    told = predictive(blocks, found)
    assert difference(blocks, told, predictive(blocks, without)).clear
    known = replace(found, effects=(always,), jacobian=found.jacobian[:, 5:])
    np.testing.assert_allclose(told.spectrum, predictive(blocks, known).spectrum)
    # Where each segment is a part, it is the table that is judged: by segments that tell of it.
    few = blocks_of(layout, each_segment=True)
    assert not np.allclose(predictive(few, found).spectrum, predictive(few, known).spectrum)


def test_few_nats_are_never_clear():
    rng, layout = np.random.default_rng(0), recorded()
    column = np.sin(np.linspace(0.0, 90.0, layout.size))[:, None]
    noise = rng.standard_normal(layout.size)
    gains = [
        gain(layout, size * column[:, 0] + noise, column) for size in np.linspace(1.0, 9.0, 60)
    ]
    for told in gains:
        assert told.error >= np.sqrt(2.0 * abs(told.nats))
        assert not (told.clear and told.nats < 8.0)
        assert told.visible == (told.nats > 8.0)  # so that what is not visible is never clear
    assert min(one.nats for one in gains) < 2.0
    assert any(one.clear for one in gains)


@pytest.mark.parametrize("nats", [2.0, 8.0])
def test_of_two_predictions_one_right_the_log_ratio_varies_by_twice_its_mean(nats):
    rng = np.random.default_rng(0)
    there = rng.standard_normal((20_000, 4)) + np.sqrt(nats / 2.0)
    ratio = 0.5 * (there**2 - (there - np.sqrt(nats / 2.0)) ** 2).sum(axis=1)
    assert ratio.mean() == pytest.approx(nats, rel=0.05)
    assert np.var(ratio) == pytest.approx(2.0 * ratio.mean(), rel=0.05)


def test_a_discrepancy_that_all_blocks_share_makes_the_standard_error_larger():
    """Two hypotheses that differ in what each leaves: the same everywhere, beside much or none."""
    rng, layout = np.random.default_rng(0), recorded(recordings=4, segments=5)
    blocks, noise = blocks_of(layout), rng.standard_normal(layout.size)
    time_s = np.tile((np.arange(400) + 0.5) / 200.0, 20)
    wave, other = np.cos(2.0 * np.pi * 1.5 * time_s), np.cos(2.0 * np.pi * 1.25 * time_s)

    def apart(size):
        one, two = (predictive(blocks, fitted(noise + size * w)) for w in (wave, other))
        return difference(blocks, one, two)

    near, far = apart(0.01), apart(30.0)
    assert far.error > 5.0 * near.error
    assert not far.clear


def test_blocks_with_a_discrepancy_in_common_count_as_few():
    blocks = blocks_of(recorded(recordings=20, segments=5))
    number = blocks.count.sum(axis=0)
    np.testing.assert_allclose(effective(blocks, np.ones(len(number))), number)
    wrong = effective(blocks, np.full(len(number), 1e9))
    np.testing.assert_allclose(wrong, number / (1.0 + (number - 1.0) * WRONG_ALIKE))
    assert (wrong <= 1.0 / WRONG_ALIKE).all()
    halfway = effective(blocks, np.full(len(number), 2.0))
    assert ((wrong < halfway) & (halfway < number)).all()


@pytest.mark.parametrize("size", [1.0, 3.0, 100.0])
def test_no_hypothesis_gains_more_than_there_is_room(size):
    rng, layout = np.random.default_rng(0), recorded(joints=("a", "b"))
    blocks = blocks_of(layout)
    wave = np.sin(np.linspace(0.0, 200.0, layout.size))
    residual = size * wave + rng.standard_normal(layout.size)
    here = predictive(blocks, fitted(residual))
    most = room(blocks, here)
    share = effective(blocks, here.scale) / blocks.count.sum(axis=0)
    others = (
        fitted(residual, wave[:, None]),
        fitted(residual, rng.standard_normal((layout.size, 5))),
        fitted(np.zeros(layout.size)),
    )
    for other in others:
        better = predictive(blocks, other).density - here.density
        assert float(better.sum(axis=0) @ share) <= most.nats + 1e-6


def test_there_is_no_room_beside_what_a_right_model_leaves():
    rng, layout = np.random.default_rng(0), recorded()
    blocks = blocks_of(layout)
    noise = rng.standard_normal(layout.size)
    assert not room(blocks, predictive(blocks, fitted(noise))).clear
    wrong = noise + 50.0 * np.sin(np.linspace(0.0, 90.0, layout.size))
    assert room(blocks, predictive(blocks, fitted(wrong))).clear


@pytest.mark.parametrize(("nats", "clear"), [(-5.0, False), (CLEARLY, False), (2.01, True)])
def test_clear_is_what_exceeds_so_many_standard_errors(nats, clear):
    told = Difference(nats, 1.0)
    assert told.errors == nats
    assert told.clear is clear


def test_few_constants_decide_a_name():
    numbers = [v for name, v in vars(constants).items() if name.isupper()]
    assert len(numbers) <= 10
    assert all(np.isfinite(np.ravel(v)).all() for v in numbers)
    predicts, differs, holds, bent, unlike = constants.CONFIDENCE
    assert predicts > 0.0 < holds
    assert differs < 0.0 > bent
    assert unlike < 0.0
