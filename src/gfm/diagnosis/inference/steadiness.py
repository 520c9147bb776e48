"""Whether a law holds in all parts of the data.

A law that holds has the same amounts early and late, in large motions and in small ones, and in
every state of its joint. One that only comes near to what acts is fitted to each part anew, and
what it misses is what it would do if it were bent. With little noise, fits are sure of either.

Shape letters: N numbers of a residual, P parameters, K ways to bend a law.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.diagnosis.inference.blocks import Blocks
from gfm.diagnosis.inference.constants import CLEARLY
from gfm.diagnosis.inference.fitting import Fit, without
from gfm.diagnosis.inference.score import RIDGE


def apart(fitted: Fit, blocks: Blocks, own: NDArray[np.bool_], response: Array) -> float:
    """Returns by what share of itself an effect may differ between parts of the data.

    By how much it clearly does, and what chance may add: two standard errors of it in all parts.
    To first order around amounts that were fitted to all; the most of three pairs of parts:
    recordings (blocks, where there is one) in turn, the early and the late half of each, and where
    the effect does little and where it does much. What chance makes of a difference is taken off
    its square (as DerSimonian and Laird 1986 do between studies). A part in which the effect does
    next to nothing is sure of no amount.

    Args:
        fitted: The effect, and what else the parts know of.
        blocks: How the residual is divided.
        own: Which parameters are the effect's, shape (P,).
        response: What the effect does in the residual, shape (N,).
    """
    scaled = fitted.jacobian / (np.linalg.norm(fitted.jacobian, axis=0) + 1e-9)
    square = scaled[:, own].T @ scaled[:, own]
    rows = [piece.ravel() for piece in blocks.pieces]
    strength = np.array([np.mean(response[one] ** 2) for one in rows])
    _, variance = _told(scaled, fitted.residual, rows)
    differs, unsure = [0.0], float(np.trace(square @ variance[np.ix_(own, own)]))
    for parts in _parts(blocks.recording, strength):
        told = [_told(scaled, fitted.residual, [rows[i] for i in part]) for part in parts]
        change = (told[0][0] - told[1][0])[own]
        covariance = (told[0][1] + told[1][1])[np.ix_(own, own)]
        size, chance = float(change @ square @ change), float(np.trace(square @ covariance))
        if size > CLEARLY**2 * chance:
            differs.append(size - chance)
    amount = max(float(response @ response), 1.0)
    return float((np.sqrt(max(differs)) + CLEARLY * np.sqrt(unsure)) / np.sqrt(amount))


def bends(fitted: Fit, ways: Array, blocks: Blocks, joint: int) -> float:
    """Returns how much of what is left on a joint a law leaves that should bend, 0..1.

    The share of the squares there that the law explains, to first order, if its amount may change
    with the state, beside what other amounts of everything would, and beyond chance. As much as is
    left on other joints anyway says nothing of this law: that share of it does not count.

    Args:
        fitted: What was fitted, the law among it.
        ways: What the law changes in the residual, bent in K ways, shape (N, K).
        blocks: How the residual is divided.
        joint: On which the law acts, by its number.
    """
    columns = np.concatenate([fitted.jacobian, ways], axis=1)
    scaled = columns / (np.linalg.norm(columns, axis=0) + 1e-9)
    change, covariance = _told(scaled, fitted.residual, [piece.ravel() for piece in blocks.pieces])
    known, own = np.split(scaled, [fitted.jacobian.shape[1]], axis=1)
    beyond = without(own, np.linalg.qr(known)[0])
    rows = np.concatenate([piece.reshape(-1, piece.shape[2]) for piece in blocks.pieces])
    square, bend = beyond[rows[:, joint]].T @ beyond[rows[:, joint]], len(known.T)
    told = float(change[bend:] @ square @ change[bend:])
    chance = float(np.trace(square @ covariance[bend:, bend:]))
    costs = np.mean(fitted.residual[rows] ** 2, axis=0)
    here = max(float(costs[joint]), 1e-9)
    beyond_usual = 1.0 - _usual(np.delete(costs, joint)) / here
    return float(np.clip((told - chance) / (here * len(rows)) * beyond_usual, 0.0, 1.0))


def _usual(costs: Array) -> float:
    """Returns what is left on other joints beyond noise, as a mean square.

    The median. Where most is left may be where this joint's own error arrives: it does not count.
    """
    some = np.sort(costs)[:-1]
    return max(float(np.median(some)) - 1.0, 0.0) if len(some) else 0.0


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
