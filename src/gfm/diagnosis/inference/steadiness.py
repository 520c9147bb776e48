"""Whether parts of the data tell the same amounts.

A law that holds has the same amounts early and late, in large motions and in small ones. One that
only comes near to what acts is fitted to each part anew. How sure a fit is of amounts does not tell
the two apart: with little noise both are sure. By what share of itself an effect differs does.

Shape letters: N numbers of a residual, P parameters, B blocks, E effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.diagnosis.inference.score import RIDGE


def apart(
    jacobian: Array,
    residual: Array,
    blocks: Sequence[NDArray[np.intp]],
    order: Sequence[NDArray[np.intp]],
    columns: NDArray[np.bool_],
    response: Array,
) -> float:
    """Returns by what share of itself an effect differs between parts of the data, beyond chance.

    To first order around amounts that were fitted to all of them; the most of three pairs of parts:
    recordings (blocks, where there is one) in turn, the early and the late half of each, and where
    the effect does little and where it does much. What chance makes of a difference is taken off
    its square (as DerSimonian and Laird 1986 do between studies).

    Args:
        jacobian: Derivative of the residual, shape (N, P).
        residual: At the optimum, shape (N,).
        blocks: Rows of each block, B of them.
        order: Blocks of each recording, first to last.
        columns: Which parameters are the effect's, shape (P,).
        response: What the effect changes in the residual, shape (N,).
    """
    scaled = jacobian / (np.linalg.norm(jacobian, axis=0) + 1e-9)
    own, size = scaled[:, columns].T @ scaled[:, columns], float(response @ response)
    strength = np.array([np.mean(response[rows] ** 2) for rows in blocks])
    shares = [0.0]
    for parts in _parts(order, strength):
        told = [_told(scaled, residual, [blocks[i] for i in part]) for part in parts]
        change = (told[0][0] - told[1][0])[columns]
        covariance = (told[0][1] + told[1][1])[np.ix_(columns, columns)]
        beyond = max(float(change @ own @ change) - float(np.trace(own @ covariance)), 0.0)
        shares.append(float(np.sqrt(beyond / max(size, 1.0))))
    return max(shares)


def _parts(
    order: Sequence[NDArray[np.intp]], strength: Array
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yields pairs of parts, each as its blocks; none where one is empty."""
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
