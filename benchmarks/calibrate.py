"""Constants of the confidence, fitted to names whose truth is known.

    python benchmarks/calibrate.py runs/known_truth runs/known_truth_other

Logistic regression from the figures under `evidence` in reports that `diagnosis.py` made. What it
is worth is judged on cases that it was not fitted to, each left out once.

Shape letters: N names, F features (the first is 1).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from known_truth.robots import Array
from known_truth.told import Told, all_told
from scipy.optimize import minimize

FEATURES = ("constant", "z_without", "z_rival", "left", "apart")
#: Weight of the squares of all amounts but the constant: without it they run away where right and
#: wrong names can be parted without error. As much as a single name's.
_RIDGE = 1.0
_LEAST_LEFT = 1e-6
#: Confidences of nought and one would cost infinitely much where they are wrong.
_LEAST_CONFIDENCE = 1e-3


def features(evidence: Mapping[str, Any] | None) -> Array | None:
    """Returns what the confidence is made of, shape (F,); None where a figure is missing."""
    figures = [(evidence or {}).get(name) for name in FEATURES[1:]]
    if any(value is None or not math.isfinite(value) for value in figures):
        return None
    z_without, z_rival, left, apart = (float(value) for value in figures if value is not None)
    return np.array(
        [
            1.0,
            math.log1p(max(z_without, 0.0)),
            math.log1p(max(z_rival, 0.0)),
            math.log10(max(left, _LEAST_LEFT)),
            math.sqrt(max(apart, 0.0)),
        ]
    )


def fit(X: Array, right: Array) -> Array:
    """Returns the amounts of a logistic regression, shape (F,).

    Args:
        X: Features, shape (N, F).
        right: 1 for right names, 0 for wrong ones, shape (N,).
    """

    def loss(amounts: Array) -> tuple[float, Array]:
        logit = X @ amounts
        held = np.concatenate([[0.0], amounts[1:]])
        value = np.sum(np.logaddexp(0.0, logit) - right * logit) + 0.5 * _RIDGE * held @ held
        return float(value), X.T @ (probability(logit) - right) + _RIDGE * held

    return np.asarray(minimize(loss, np.zeros(X.shape[1]), jac=True, method="BFGS").x)


def probability(logit: Array) -> Array:
    """Returns 1 / (1 + exp(-logit))."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))


def log_loss(confidence: Array, right: Array) -> float:
    """Returns the mean of -log of the probability given to what is so; ln 2 of mere guessing."""
    safe = np.clip(confidence, _LEAST_CONFIDENCE, 1.0 - _LEAST_CONFIDENCE)
    return float(-np.mean(np.where(right > 0.5, np.log(safe), np.log1p(-safe))))


def left_out(X: Array, right: Array, cases: Sequence[str]) -> Array:
    """Returns the confidence in each name by a fit to all other cases, shape (N,)."""
    groups = np.array(cases)
    confidence = np.zeros(len(right))
    for case in dict.fromkeys(cases):
        here = groups == case
        confidence[here] = probability(X[here] @ fit(X[~here], right[~here]))
    return confidence


def constants(amounts: Array) -> str:
    """Returns the amounts as a line of Python."""
    pairs = ", ".join(f'"{n}": {a:.3f}' for n, a in zip(FEATURES, amounts, strict=True))
    return f"_LOGIT = {{{pairs}}}"


def summary(told: Sequence[Told]) -> str:
    """Returns what comes of a fit to all names that carry evidence."""
    pairs = [(one, row) for one in told if (row := features(one.evidence)) is not None]
    skipped = f"{len(told) - len(pairs)} of {len(told)} names carry no evidence: skipped"
    right = np.array([float(one.right) for one, _ in pairs])
    if not 0.0 < right.sum() < len(right):
        return f"{skipped}\nnothing to fit: right and wrong names are needed, both with evidence"
    X, cases = np.stack([row for _, row in pairs]), [one.case for one, _ in pairs]
    amounts = fit(X, right)
    said = np.array([one.confidence for one, _ in pairs])
    lines = [
        skipped,
        f"{len(right)} names of {len(set(cases))} cases, {right.sum():.0f} right",
        *(f"  {n:10s} {a:+.3f}" for n, a in zip(FEATURES, amounts, strict=True)),
        f"log loss, fitted                {log_loss(probability(X @ amounts), right):.4f}",
        f"log loss, each case left out    {log_loss(left_out(X, right, cases), right):.4f}",
        f"log loss of what reports say    {log_loss(said, right):.4f}",
        f"log loss of the share of right  {log_loss(np.full_like(right, right.mean()), right):.4f}",
        constants(amounts),
    ]
    return "\n".join(lines)


def main() -> None:
    """Collects the evidence, fits, and prints the constants."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    told, _ = all_told(parser.parse_args().folders)
    print(summary(told))


if __name__ == "__main__":
    main()
