"""Which attempts a diagnosis learns from, and which judge it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from gfm.experiments.attempts import Attempt

#: Attempts that are learned from at least, as many as in the paper, and that judge.
LEARNED_FROM, JUDGED_ON = 5, 5
#: What is learned from is to last as long: attempts that the bridge ends soon tell little each, and
#: of those in which it holds the arm by positions only the time before is recorded.
LEARNED_S = 60.0

T = TypeVar("T")


def learned_from(made: Sequence[Attempt], lasts_s: Callable[[Attempt], float]) -> list[Attempt]:
    """Returns first attempts at goals from first to last, then others: all but the last at each.

    Of these as many as there have to be, and further ones until all last long enough.

    Args:
        made: All attempts.
        lasts_s: Of one, how long a recording there is that can be learned from, s; 0 for none.
    """
    earlier = [one for one in made if one.trial < _last(made) and lasts_s(one) > 0.0]
    first = spread([one for one in earlier if one.trial == 0], LEARNED_FROM)
    others = [one for one in earlier if all(one is not other for other in first)]
    chosen = list(first)
    for one in sorted(others, key=lambda one: one.trial):
        if len(chosen) >= LEARNED_FROM and sum(map(lasts_s, chosen)) >= LEARNED_S:
            break
        chosen.append(one)
    return chosen


def judged_on(made: Sequence[Attempt], lasts_s: Callable[[Attempt], float]) -> list[Attempt]:
    """Returns last attempts at goals, from first to last; arguments as of `learned_from`."""
    last = [one for one in made if one.trial == _last(made) and lasts_s(one) > 0.0]
    return spread(last, JUDGED_ON)


def spread(items: Sequence[T], most: int) -> list[T]:
    """Returns at most so many of them, from first to last."""
    if not items:
        return []
    kept = np.unique(np.linspace(0, len(items) - 1, most).round().astype(int))
    return [items[i] for i in kept]


def _last(made: Sequence[Attempt]) -> int:
    return max(one.trial for one in made)
