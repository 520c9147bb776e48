"""Whether a law holds in all parts of the data.

A law that holds has the same amounts early and late, in large motions and in small ones, and leaves
as much where it acts strongly as where it hardly acts. One that only comes near to what acts is
fitted to each part anew, and what it misses grows with what it does. How sure a fit is of amounts
does not tell the two apart: with little noise both are sure.

Shape letters: N numbers of a residual, P parameters, B blocks, E effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from gfm.core.checks import Array
from gfm.diagnosis.inference.constants import INEXACT_SHARE, LEAST_DISCREPANCY
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.score import RIDGE, Blocks

#: Ranks that differ by less are the same; most that two are alike, so that it stays finite.
SAME_RANKS, MOST_ALIKE = 1e-6, 1.0 - 1e-6


def apart(fitted: Fit, blocks: Blocks, own: NDArray[np.bool_], response: Array) -> float:
    """Returns by what share of itself an effect differs between parts of the data, beyond chance.

    To first order around amounts that were fitted to all of them; the most of three pairs of parts:
    recordings (blocks, where there is one) in turn, the early and the late half of each, and where
    the effect does little and where it does much. What chance makes of a difference is taken off
    its square (as DerSimonian and Laird 1986 do between studies).

    Args:
        fitted: The effect, and what else the parts know of.
        blocks: How the residual is divided.
        own: Which parameters are the effect's, shape (P,).
        response: What the effect changes in the residual, shape (N,).
    """
    scaled = fitted.jacobian / (np.linalg.norm(fitted.jacobian, axis=0) + 1e-9)
    square, size = scaled[:, own].T @ scaled[:, own], float(response @ response)
    rows = [piece.ravel() for piece in blocks.pieces]
    strength = np.array([np.mean(response[one] ** 2) for one in rows])
    shares = [0.0]
    for parts in _parts(blocks.recording, strength):
        told = [_told(scaled, fitted.residual, [rows[i] for i in part]) for part in parts]
        change = (told[0][0] - told[1][0])[own]
        covariance = (told[0][1] + told[1][1])[np.ix_(own, own)]
        beyond = max(float(change @ square @ change) - float(np.trace(square @ covariance)), 0.0)
        shares.append(float(np.sqrt(beyond / max(size, 1.0))))
    return max(shares)


def follows(
    left: Array, response: Array, motion: Array, blocks: Blocks, joints: Sequence[int]
) -> float:
    """Returns how closely what is left follows what an effect does, block by block, beyond chance.

    And beyond how both follow motion, with which most of what a model lacks grows: a partial rank
    correlation (Spearman), made normal as Fisher (1924) does, chance taken off its square. What
    laws that hold leave by not being quite exact is taken off before.

    Args:
        left: The residual, in units of the noise, shape (N,).
        response: What the effect changes in it, shape (N,).
        motion: How fast what is measured moves, in any units, shape (N,).
        blocks: How all three are divided.
        joints: On which it acts, by their numbers.
    """
    rows = [piece[:, :, joints] for piece in blocks.pieces]
    square, strength, speed = (
        np.array([np.mean(one[piece] ** 2) for piece in rows]) for one in (left, response, motion)
    )
    inexact = 1.0 + LEAST_DISCREPANCY**2 + INEXACT_SHARE * strength
    freedom = len(rows) - 4  # one control beside the three of any correlation
    alike = _partial_rank_correlation(np.maximum(square - inexact, 0.0), strength, speed)
    if freedom < 1 or alike <= 0.0:
        return 0.0
    return float(np.sqrt(max(np.arctanh(alike) ** 2 - 1.0 / freedom, 0.0)))


def _partial_rank_correlation(one: Array, other: Array, control: Array) -> float:
    """Returns how alike two are in rank, beyond what either has in common with a third, -1..1."""
    known = np.stack([np.ones(len(control)), rankdata(control)], axis=1)
    ranks = np.stack([rankdata(one), rankdata(other)], axis=1)
    beyond = ranks - known @ np.linalg.lstsq(known, ranks, rcond=None)[0]
    size = np.linalg.norm(beyond, axis=0)
    if size.min() < SAME_RANKS:
        return 0.0
    return float(np.clip(beyond[:, 0] @ beyond[:, 1] / size.prod(), -MOST_ALIKE, MOST_ALIKE))


def _parts(
    recording: NDArray[np.intp], strength: Array
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yields pairs of parts, each as its blocks; none where one is empty."""
    order = [np.flatnonzero(recording == one) for one in np.unique(recording)]
    turn = [one for own in order for one in np.split(own, len(own))] if len(order) < 2 else order
    halves = [np.array_split(own, 2) for own in order]
    weakest_first = np.argsort(strength, kind="stable")
    pairs = [
        (np.concatenate(turn[::2]), np.concatenate(turn[1::2] or [np.zeros(0, np.intp)])),
        (np.concatenate([h[0] for h in halves]), np.concatenate([h[1] for h in halves])),
        (weakest_first[: len(strength) // 2], weakest_first[len(strength) // 2 :]),
    ]
    yield from (pair for pair in pairs if len(pair[0]) and len(pair[1]))


def _told(
    scaled: Array, residual: Array, blocks: Sequence[NDArray[np.intp]]
) -> tuple[Array, Array]:
    """Returns by how much one part of the data asks for other amounts, and how sure that is.

    From those of all data, in units of what all data tell, shape (P,), and the covariance of that
    by how blocks differ (White 1980), shape (P, P).
    """
    rows = np.concatenate(blocks)
    inner = scaled[rows].T @ scaled[rows] + RIDGE * np.eye(scaled.shape[1])
    bread = np.linalg.inv(inner)
    change = -bread @ (scaled[rows].T @ residual[rows])
    scores = np.stack([scaled[b].T @ (residual[b] + scaled[b] @ change) for b in blocks])
    meat = scores.T @ scores * len(blocks) / max(len(blocks) - 1, 1)
    return change, bread @ meat @ bread
