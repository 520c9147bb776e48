"""Constants of the confidence, fitted to names whose truth is known.

    python benchmarks/calibrate.py runs/known_truth runs/known_truth_other

A product of two logistic functions of the figures under `evidence` in reports that `diagnosis.py`
made: that nothing else says it as well, and that the law holds. Robots with a law that the library
lacks count as often as in a whole suite, however many of them were diagnosed. What the fit is worth
is judged on cases that it was not fitted to, each left out once. A figure that is new, which few
reports carry, is fitted beside the others as they are (`--last`).

Shape letters: N names, F features.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from known_truth.plans import plans
from known_truth.robots import Array
from known_truth.told import Told, all_told
from scipy.optimize import minimize

from gfm.diagnosis.inference.constants import CONFIDENCE
from gfm.diagnosis.output.claims import APART, MOST_BENT

FEATURES = ("z_rival", "apart", "bends", "disagrees")
#: Weights of the squares of all amounts: without them they run away where right and wrong names can
#: be parted without error. Those of the law's figure, which lies closer together, count less.
_RIDGE = np.array([1.0, 1.0, 0.1, 0.1, 0.1])
_BEGUN = np.array([1.0, -1.0, 2.0, -4.0, -4.0])
#: Percentile, for `UNWEIGHED`, of the shares of what speaks for names against their best rivals.
_LOWER_QUARTILE = 25.0
#: Confidences of nought and one would cost infinitely much where they are wrong.
_LEAST_CONFIDENCE = 1e-3


def features(evidence: Mapping[str, Any] | None) -> Array | None:
    """Returns what the confidence is made of, shape (F,); None where a figure is missing.

    Where nothing rivals a name, it is weighed against the model without it.
    """
    told = dict(evidence or {})
    told.setdefault("z_rival", told.get("z_without"))
    figures = [told.get(name) for name in FEATURES]
    if any(value is None or not math.isfinite(value) for value in figures):
        return None
    z_rival, apart, bends, disagrees = (float(value) for value in figures if value is not None)
    return np.array(
        [
            math.log1p(max(z_rival, 0.0)),
            math.log1p(max(apart, 0.0) / APART),
            math.atanh(math.sqrt(min(bends, MOST_BENT))),
            disagrees,
        ]
    )


def lacks_a_law(case: str) -> bool:
    """Returns whether a case hides a law that the library does not have."""
    return "-outside-" in case or "-beside-" in case


def weights_of(cases: Sequence[str]) -> Array:
    """Returns how much each name counts, one in the mean, shape (N,): see the top of this file."""
    distinct, suite = set(cases), [plan.name for plan in plans(0)]
    asked, there = (
        sum(map(lacks_a_law, names)) / len(names) for names in (suite, sorted(distinct))
    )
    if not 0.0 < there < 1.0:
        return np.ones(len(cases))
    lacking = np.array([lacks_a_law(case) for case in cases])
    weights = np.where(lacking, asked / there, (1.0 - asked) / (1.0 - there))
    return np.asarray(weights / weights.mean())


def confidence(X: Array, amounts: Array) -> Array:
    """Returns what `output.claims.confidence` says by some amounts, shape (N,)."""
    predicts, differs, holds, bent, unlike = amounts
    better = probability(predicts * X[:, 0] + differs * X[:, 1])
    return np.asarray(better * probability(holds + bent * X[:, 2] + unlike * X[:, 3]))


def fit(X: Array, right: Array, weights: Array | None = None, held: Sequence[float] = ()) -> Array:
    """Returns the likeliest amounts of `CONFIDENCE`, shape (F + 1,).

    Args:
        X: Features, shape (N, F).
        right: 1 for right names, 0 for wrong ones, shape (N,).
        weights: How much each counts, shape (N,); all the same by default.
        held: The first amounts, where these are known.
    """
    weights = np.ones(len(right)) if weights is None else weights
    first = np.array(held)

    def loss(rest: Array) -> float:
        amounts = np.concatenate([first, rest])
        lost = weights.sum() * log_loss(confidence(X, amounts), right, weights)
        return float(lost + 0.5 * _RIDGE @ amounts**2)

    return np.concatenate([first, minimize(loss, _BEGUN[len(first) :], method="BFGS").x])


def probability(logit: Array) -> Array:
    """Returns 1 / (1 + exp(-logit))."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))


def log_loss(told: Array, right: Array, weights: Array | None = None) -> float:
    """Returns the mean of -log of the probability given to what is so; ln 2 of mere guessing."""
    safe = np.clip(told, _LEAST_CONFIDENCE, 1.0 - _LEAST_CONFIDENCE)
    lost = -np.where(right > 0.5, np.log(safe), np.log1p(-safe))
    return float(np.average(lost, weights=weights))


def left_out(
    X: Array,
    right: Array,
    cases: Sequence[str],
    weights: Array | None = None,
    held: Sequence[float] = (),
) -> Array:
    """Returns the confidence in each name by a fit to all other cases, shape (N,)."""
    groups, told = np.array(cases), np.zeros(len(right))
    weights = np.ones(len(right)) if weights is None else weights
    for case in dict.fromkeys(cases):
        here = groups == case
        told[here] = confidence(X[here], fit(X[~here], right[~here], weights[~here], held))
    return told


def constants(amounts: Array) -> str:
    """Returns the amounts as a line of Python."""
    return f"CONFIDENCE = ({', '.join(f'{a:.2f}' for a in amounts)})"


def unweighed(told: Sequence[Told]) -> str:
    """Returns the lower quartile of what speaks against a rival, as a line of Python."""
    figures = [one.evidence or {} for one in told]
    shares = [
        f["z_rival"] / f["z_without"]
        for f in figures
        if "z_rival" in f and f.get("z_without", 0.0) > 1.0
    ]
    if not shares:
        return "UNWEIGHED: no name has a rival"
    return f"UNWEIGHED = {np.percentile(shares, _LOWER_QUARTILE):.2f}  # of {len(shares)} names"


def summary(told: Sequence[Told], held: Sequence[float] = ()) -> str:
    """Returns what comes of a fit to all names that carry evidence, some amounts held."""
    pairs = [(one, row) for one in told if (row := features(one.evidence)) is not None]
    skipped = f"{len(told) - len(pairs)} of {len(told)} names carry no evidence: skipped"
    right = np.array([float(one.right) for one, _ in pairs])
    if not 0.0 < right.sum() < len(right):
        return f"{skipped}\nnothing to fit: right and wrong names are needed, both with evidence"
    X, cases = np.stack([row for _, row in pairs]), [one.case for one, _ in pairs]
    weights = weights_of(cases)
    amounts = fit(X, right, weights, held)
    guess = np.full_like(right, np.average(right, weights=weights))
    as_reported = np.array([one.confidence for one, _ in pairs])
    rows = {
        "fitted": confidence(X, amounts),
        "each case left out": left_out(X, right, cases, weights, held),
        "of what reports say": as_reported,
        "of the share of right": guess,
    }
    lines = [
        skipped,
        f"{len(right)} names of {len(set(cases))} cases, {right.sum():.0f} right",
        *(f"log loss, {n:24s}{log_loss(c, right, weights):.4f}" for n, c in rows.items()),
        unweighed(told),
        constants(amounts),
    ]
    return "\n".join(lines)


def main() -> None:
    """Collects the evidence, fits, and prints the constants."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    parser.add_argument(
        "--last", action="store_true", help="fit the weight of the last figure beside the others"
    )
    asked = parser.parse_args()
    told, _ = all_told(asked.folders)
    print(summary(told, CONFIDENCE[:-1] if asked.last else ()))


if __name__ == "__main__":
    main()
