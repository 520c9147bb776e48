"""Why the search for effects ended where it ended, and how often such a search finds too much."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import beta

from gfm.diagnosis.former.adequate import FAR_LESS, enough
from gfm.diagnosis.former.attribution import MOST_ROUNDS, OBVIOUS, Attribution, Round, price
from gfm.diagnosis.inference.fitting import LEAST_GAIN, Fit, at_bound
from gfm.diagnosis.search.naming import describe, twins

#: Simulated robots without any hidden effect that were diagnosed (of docs/results, 75 of
#: known_truth*.md, 10 of run_random_effects.md), and those of them on which anything was named.
CLEAN_ROBOTS, FALSE_ALARMS = 85, 0


@dataclass(frozen=True, kw_only=True)
class RoundRow:
    """One round of the search.

    Attributes:
        before: Mean squared residual that was left, in units of the noise.
        best: The candidate that explains most, in words; empty where none was fitted.
        explained: Share of what was left that it explains.
        needed: Share that it has to explain: for all its parameters, or, of several effects
            together, far more than the best alone.
        accepted: Whether it was.
        stretches: How many stretches the round was about, those that stayed far off; 0 for all.
        restated: Whether what the model itself says of its joints was fitted anew.
        answers: How many answers to steps it was about, beside the rollouts; 0 for none.
        instead_of: What made way for the best candidate, in words; empty if nothing did.
    """

    before: float
    best: str
    explained: float
    needed: float
    accepted: bool
    stretches: int = 0
    restated: bool = False
    answers: int = 0
    instead_of: str = ""


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """How the search went and ended.

    Attributes:
        rounds: First to last.
        left: Mean squared residual in the end, in units of the noise.
        enough: That at which it ends: nothing is left to explain.
        reason: Why it ended, in words.
        taken_out: What was accepted, and is not among the accepted in the end, with the reason.
        clean_robots: Robots without a hidden effect that were diagnosed to see how often it errs.
        false_alarms: Those of them on which anything was named.
    """

    rounds: tuple[RoundRow, ...]
    left: float
    enough: float
    reason: str
    taken_out: tuple[str, ...] = ()
    clean_robots: int = CLEAN_ROBOTS
    false_alarms: int = FALSE_ALARMS

    @property
    def at_most(self) -> float:
        """Largest rate of false alarms that the clean robots leave possible (95 %, exact)."""
        return largest_rate(self.false_alarms, self.clean_robots)


def largest_rate(errors: int, cases: int) -> float:
    """Returns the upper end of the one-sided 95 % interval of a rate (Clopper and Pearson 1934)."""
    return 1.0 if errors >= cases else float(beta.ppf(0.95, errors + 1, cases - errors))


def stopping(found: Attribution) -> Stopping:
    """Returns how a search went and why it ended."""
    at_most = enough(found.nominal_cost, found.fit.effects)
    return Stopping(
        rounds=tuple(_row(this) for this in found.rounds),
        left=found.fit.cost,
        enough=at_most,
        reason=_reason(found, at_most),
        taken_out=_taken_out(found),
    )


def _taken_out(found: Attribution) -> tuple[str, ...]:
    left = {e.key for e in found.fit.effects} | {twin.key for twin, _ in twins(found.fit.effects)}
    won = [e for this in found.rounds if this.accepted is not None for e in this.new]
    accepted = (*won, *found.unsupported)  # what came with another joint's has no round of its own
    gone = {describe(e): found.why_taken_out(e) for e in accepted if e.key not in left}
    return tuple(f"{words}: {why}" for words, why in gone.items())


def _row(this: Round) -> RoundRow:
    if not this.fits:
        return RoundRow(before=this.before, best="", explained=0.0, needed=0.0, accepted=False)
    best, alone = this.fits[0], this.fits[1].cost if len(this.fits) > 1 else this.before
    together = f"{len(this.new)} effects together"
    return RoundRow(
        before=this.before,
        best=together if this.together else describe(best.effects[-1]),
        explained=1.0 - best.cost / this.before,
        needed=_needed(this, best, alone),
        accepted=this.accepted is not None,
        stretches=this.stretches,
        restated=this.restated,
        answers=0 if this.late_s is None else len(this.late_s[0]),
        instead_of=describe(this.instead_of) if this.instead_of else "",
    )


def _needed(this: Round, best: Fit, alone: float) -> float:
    """Returns the share of what was left that had to be explained."""
    if this.restated:
        return 1.0 - FAR_LESS if this.late_s is None else LEAST_GAIN
    if this.together:
        return 1.0 - FAR_LESS * alone / this.before
    return OBVIOUS if this.stretches else price(best)


def _reason(found: Attribution, at_most: float) -> str:
    played = [this for this in found.rounds if not this.instead_of and not this.restated]
    rounds = [this for this in played if not this.stretches]
    if not rounds:
        return "the nominal model leaves no more than noise: nothing was looked for"
    last = rounds[-1]
    if last.accepted is not None:
        if len(played) >= MOST_ROUNDS:
            return f"{MOST_ROUNDS} rounds were played, the most there are"
        return (
            f"what is left is noise, or as little as the laws are inexact (at most {at_most:.3g})"
        )
    if not last.fits:
        return (
            "no candidate explains enough, or more than what is adequate may leave, or holds for "
            "recordings it was not fitted to"
        )
    if at_bound(last.fits[0].effects[-1]):
        best = describe(last.fits[0].effects[-1])
        return f"{best} explains most, but its amount is next to none, or has no end"
    return (
        "no candidate explains enough of what is left, which is "
        f"{100.0 * LEAST_GAIN:.0f} % for each of its parameters"
    )
