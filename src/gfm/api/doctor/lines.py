"""How checks write their lines."""

from __future__ import annotations

from collections.abc import Sequence

from gfm.report.checks import Check, Level


def well(name: str, found: str) -> Check:
    """Returns the line of a check with nothing to mend."""
    return Check(name=name, level=Level.OK, found=found)


def doubt(name: str, found: str, advice: str) -> Check:
    """Returns a line about what a diagnosis goes on with."""
    return Check(name=name, level=Level.WARN, found=found, advice=advice)


def refusal(name: str, words: Exception | str, advice: str = "") -> Check:
    """Returns a line about what a diagnosis refuses, in the words of its error.

    Args:
        name: Of the check.
        words: "found; expected ...".
        advice: What to do; by default what was expected.
    """
    found, _, expected = str(words).partition("; expected ")
    advice = advice or (f"expected {expected}" if expected else "")
    return Check(name=name, level=Level.REFUSE, found=found, advice=advice)


def some(names: Sequence[str], most: int = 6) -> str:
    """Returns names, and how many more there are than a line takes."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
