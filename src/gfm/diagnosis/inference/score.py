"""The one score by which hypotheses are compared: how well they predict what they were not told.

A residual is divided into blocks and cells (`inference.blocks`). In every cell it has a variance:
sensor noise and the discrepancy of a model that is not quite right. The latter is estimated, cell
by cell, from all other blocks; blocks differ in how far a model is off, so that their density is
Student's t. Amounts are those that the other recordings alone would give, to first order. The score
is the logarithm of that density, summed up.

A wrong model is wrong in the same way in many blocks. They tell less together than as many
independent ones would: each cell counts by its effective number of coefficients, as in cluster
sampling (Kish 1965).

Shape letters: N numbers of a residual, P parameters, B blocks, C cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.blocks import OCTAVES_HZ, Blocks
from gfm.diagnosis.inference.constants import CLEARLY, DEGREES_OF_FREEDOM, WRONG_ALIKE
from gfm.diagnosis.inference.fitting import Fit, always
from gfm.diagnosis.residuals.outliers import slopes, unbounded

#: Steps in which the scale of a cell is found.
SCALE_STEPS = 12
#: Ridge that keeps amounts finite of which the data tell nothing, and the share of what is told of
#: an amount up to which parts of the data tell nothing of it: there it stands as it was fitted.
RIDGE, TELLS_NOTHING = 1e-3, 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictive:
    """How well a hypothesis predicts each part of the data from the others.

    Attributes:
        spectrum: What it leaves there, in frequencies, shape (N,).
        mean_square: The same in each block's cells, not below what a right model leaves, (B, C).
        scale: Variance of each cell, noise and discrepancy, shape (C,).
        density: Its log predictive density, shape (B, C).
    """

    spectrum: Array
    mean_square: Array
    scale: Array
    density: Array


class Difference(NamedTuple):
    """By how much one hypothesis predicts better than another: nats, and their standard error."""

    nats: float
    error: float

    def __neg__(self) -> Difference:
        """By how much the other one predicts better."""
        return Difference(-self.nats, self.error)

    @property
    def errors(self) -> float:
        """The difference in standard errors."""
        return self.nats / max(self.error, 1e-9)

    @property
    def clear(self) -> bool:
        """Whether it is more than chance and a common discrepancy make."""
        return self.nats > CLEARLY * self.error

    @property
    def visible(self) -> bool:
        """Whether a difference that large can be clear beside what noise alone makes of it."""
        return self.nats > 2.0 * CLEARLY**2

    @property
    def same(self) -> bool:
        """Whether both predict the very same: no odds would change by as much as a factor of e."""
        return max(abs(self.nats), self.error) < 1.0

    @property
    def open(self) -> bool:
        """Whether it is clear to neither side: the data do not decide."""
        return not (self.clear or (-self).clear)

    @property
    def notable(self) -> bool:
        """Whether it is more than its own error."""
        return self.nats > self.error


#: Two hypotheses predict alike.
NOTHING = Difference(0.0, 0.0)


def predictive(blocks: Blocks, fitted: Fit) -> Predictive:
    """Returns how well effects, fitted to all other parts, predict each part of the data."""
    return _predictive(blocks, blocks.spectrum(_left_elsewhere(blocks, fitted)))


def _predictive(blocks: Blocks, spectrum: Array) -> Predictive:
    square = blocks.sums(spectrum**2) / np.maximum(blocks.count, 1.0)
    square = np.maximum(square, blocks.floor)
    scale, others = _scales(square, blocks.count)
    freedom = DEGREES_OF_FREEDOM
    density = -0.5 * blocks.count * np.log(others) - 0.5 * (freedom + blocks.count) * np.log1p(
        blocks.count * square / (freedom * others)
    )
    return Predictive(spectrum=spectrum, mean_square=square, scale=scale, density=density)


def _left_elsewhere(blocks: Blocks, fitted: Fit) -> Array:
    """Returns the residual of each part with amounts from all others, to first order, (N,).

    It counts in full, and so does what other amounts change of it. Of what acts now and then, other
    recordings may know nothing: all else would be blamed for what they make of it. It is judged by
    the few segments in which it acts, each from the others; where parts are recordings, its amounts
    stand.
    """
    left = unbounded(fitted.residual, blocks.limit)
    jacobian = fitted.jacobian if blocks.each_segment else fitted.jacobian[:, always(fitted)]
    if not jacobian.shape[1]:
        return left
    weights = slopes(fitted.residual, blocks.limit)
    columns = jacobian / (np.linalg.norm(jacobian, axis=0) + 1e-9)
    half = np.linalg.cholesky(columns.T @ columns + RIDGE * np.eye(columns.shape[1]))
    columns = np.linalg.solve(half, columns.T).T  # all parts tell as much of each way to go
    for part in np.unique(blocks.fold):
        rows = blocks.fold == part
        own = columns[rows]
        share, ways = np.linalg.eigh(own.T @ own)
        others = 1.0 - share
        further = np.divide(1.0, others, out=np.zeros_like(others), where=others > TELLS_NOTHING)
        change = own @ (ways * further) @ (ways.T @ (own.T @ fitted.residual[rows]))
        left[rows] += change / weights[rows]
    return left


def _scales(square: Array, count: Array) -> tuple[Array, Array]:
    """Returns the variance of each cell (C,), and the same without each block, (B, C).

    The most likely scale of Student's t, by expectation and maximisation.
    """
    total = np.maximum(count.sum(axis=0), 1.0)
    scale = (count * square).sum(axis=0) / total
    freedom = DEGREES_OF_FREEDOM
    for _ in range(SCALE_STEPS):
        weight = (freedom + count) / (freedom + count * square / np.maximum(scale, 1e-12))
        scale = np.maximum((weight * count * square).sum(axis=0) / total, 1.0)
    own = weight * count * square
    others = (own.sum(axis=0) - own) / np.maximum(total - count, 1.0)
    return scale, np.maximum(others, 1.0)


def effective(blocks: Blocks, scale: Array) -> Array:
    """Returns the number of independent coefficients in each cell, shape (C,).

    As in cluster sampling: of the discrepancy, blocks have a part in common.
    """
    number = blocks.count.sum(axis=0)
    discrepancy = 1.0 - 1.0 / scale
    return np.asarray(number / (1.0 + np.maximum(number - 1.0, 0.0) * WRONG_ALIKE * discrepancy**2))


def difference(blocks: Blocks, one: Predictive, other: Predictive) -> Difference:
    """Returns by how much `one` predicts better than `other`.

    The standard error is the largest of three: how far blocks differ from what could be expected of
    them, what a discrepancy that all blocks have in common lets appear better by chance (Vuong
    1989), and what noise alone makes: where one of two predictions is right, the logarithm of their
    likelihood ratio has a variance of twice its mean.
    """
    scale = np.minimum(one.scale, other.scale)
    number = effective(blocks, scale)
    share = number / np.maximum(blocks.count.sum(axis=0), 1.0)
    by_block = (share * (one.density - other.density)).sum(axis=1)
    sizes = [blocks.sums(p.spectrum**2) for p in (one, other)]
    both = blocks.sums(one.spectrum * other.spectrum)
    alike = both**2 / np.maximum(sizes[0] * sizes[1], 1e-12)
    common = float(np.sum(share * blocks.count * np.clip(1.0 - alike, 0.0, 1.0)))
    expected = share @ _told_apart(blocks, one.spectrum - other.spectrum, scale).T
    nats, apart = float(by_block.sum()), _apart(blocks, by_block, expected)
    return Difference(nats, math.sqrt(max(apart, common, 2.0 * abs(nats))))


def _told_apart(blocks: Blocks, change: Array, scale: Array) -> Array:
    """Returns by how many nats a change of prediction is told if it is right, shape (B, C).

    What is left with it is then as large as its scale says, or as what no right model falls below.
    """
    freedom = DEGREES_OF_FREEDOM
    left = freedom * scale + blocks.count * np.maximum(scale, blocks.floor)
    return 0.5 * (freedom + blocks.count) * np.log1p(blocks.sums(change**2) / left)


def _apart(blocks: Blocks, by_block: Array, expected: Array) -> float:
    """Returns the square of how far blocks are from what could be expected of them.

    Two hypotheses may differ in few blocks only: what one brings, shape (B,), goes by what it would
    if one of them were right, at the rate at which other parts of the data brought what theirs said
    (a ratio estimate, Cochran 1977). Where they say less than its own part, that rate counts by
    their share, and for the rest the one that predicts better brings all that it says.
    """
    part = np.array([blocks.fold[piece.flat[0]] for piece in blocks.pieces])
    own = part[:, None] == part
    here, elsewhere = own @ expected, expected.sum() - own @ expected
    right = np.sign(by_block.sum()) * np.maximum(here - elsewhere, 0.0)
    brought = by_block.sum() - own @ by_block + right
    rate = brought / np.maximum(np.maximum(here, elsewhere), 1e-9)
    return float(np.sum((by_block - rate * expected) ** 2))


def room(blocks: Blocks, one: Predictive) -> Difference:
    """Returns by how much any other hypothesis can predict better at most."""
    return room_by_joint(blocks, one, 1)[0]


def room_by_joint(blocks: Blocks, one: Predictive, joints: int) -> list[Difference]:
    """Returns by how much any other hypothesis can predict each joint better at most.

    Its standard error is what noise makes of it: no coefficient varies by more than twice what it
    gains in the mean.
    """
    number = effective(blocks, one.scale)
    share = number / np.maximum(blocks.count.sum(axis=0), 1.0)
    best = _predictive(blocks, np.zeros_like(one.spectrum))
    gained = share * (best.density - one.density)
    left = share * blocks.count * (1.0 - best.mean_square / one.mean_square)
    chance = np.minimum(left, 2.0 * np.maximum(gained, 0.0))
    nats, variance = (
        cells.reshape(len(cells), -1, joints, len(OCTAVES_HZ)).sum(axis=(0, 1, 3)).tolist()
        for cells in (gained, chance)
    )
    return [Difference(n, math.sqrt(v)) for n, v in zip(nats, variance, strict=True)]
