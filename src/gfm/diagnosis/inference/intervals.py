"""How sure a fit is of its parameters.

Shape letters: N numbers of a residual, P parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import stats

from gfm.core.checks import Array

#: Blocks into which a residual is cut: within one, errors may depend on each other.
BLOCKS = 60
#: Standard deviation, as a share of the amount, below which no amount is known: laws are
#: idealisations, and integrating them in time steps errs by this much.
LAW_SHARE = 0.002
#: Change of all residuals together, in units of the noise, that nobody sees.
UNSEEN = 1e-3


def half_widths(
    values: Array,
    jacobian: Array,
    residual: Array,
    segments: Sequence[slice],
    *,
    whole: bool = False,
    blocks: int = BLOCKS,
) -> Array:
    """Returns half the width of each parameter's 95 % interval, shape (P,).

    Infinite where the residual does not depend on the parameter. Arguments as of `standard_errors`.
    """
    freedom = max((len(segments) if whole else BLOCKS) - jacobian.shape[1], 1 if whole else 3)
    errors = standard_errors(values, jacobian, residual, segments, whole=whole, blocks=blocks)
    return np.asarray(stats.t.ppf(0.975, freedom) * errors)


def standard_errors(
    values: Array,
    jacobian: Array,
    residual: Array,
    segments: Sequence[slice],
    *,
    whole: bool = False,
    blocks: int = BLOCKS,
) -> Array:
    """Returns the standard error of each parameter, infinite where nothing depends on it, (P,).

    By the sandwich estimator over blocks: right also where the residual is coloured or its size
    differs from what was assumed (White 1980; blocks as in Newey and West 1987). Of whole segments,
    which are few, by how far amounts move where one of them is left out (the jackknife; MacKinnon
    and White 1985).

    Args:
        values: The estimates, shape (P,).
        jacobian: Derivative of the residual, shape (N, P).
        residual: At the optimum, shape (N,).
        segments: Segments of the residual that are independent of each other.
        whole: Whether each of them is one block: what is wrong in it stays wrong until its end.
        blocks: Into which all of them are cut; none is less than one.
    """
    normal = jacobian.T @ jacobian
    pieces = 1 if whole else max(blocks // len(segments), 1)
    edges = [np.linspace(s.start, s.stop, pieces + 1).astype(int).tolist() for s in segments]
    rows = [slice(a, b) for own in edges for a, b in pairwise(own) if b > a]
    scores = [jacobian[block].T @ residual[block] for block in rows]
    if whole:
        rests = [normal - jacobian[block].T @ jacobian[block] for block in rows]
        moves = [np.linalg.pinv(n) @ score for n, score in zip(rests, scores, strict=True)]
        share = (len(rows) - 1) / len(rows)
    else:
        moves = list(np.array(scores) @ np.linalg.pinv(normal))
        share = len(rows) / max(len(rows) - 1, 1)
    variance = share * np.sum(np.square(moves), axis=0)
    deviations = np.sqrt(variance + (LAW_SHARE * values) ** 2)
    unseen = np.linalg.norm(jacobian, axis=0) * np.maximum(np.abs(values), UNSEEN) < UNSEEN
    return np.where(unseen, np.inf, deviations)
