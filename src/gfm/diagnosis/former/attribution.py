"""Which effect is missing, and where: candidates are screened to first order, the best refitted.

One round: every candidate's response to a small amount is computed by open-loop rollouts and the
residual is regressed on it, together with the responses of what was accepted before. The candidates
that explain most are then fitted in earnest (damped Gauss-Newton over rollouts), and the one that
leaves least is accepted if it explains enough. While much stays unexplained, a model that is wrong
anyway can be bent to fit what it was fitted to: then an effect must also explain recordings that it
was not fitted to. Rounds go on until nothing explains enough; what the later effects made
superfluous is taken out at the end.

Shape letters: N numbers of a residual, P parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.former.adequate import ADEQUATE_RATIO, FAR_LESS, INEXACT, LEAST_SEEN, is_enough
from gfm.diagnosis.former.cross_validation import holds_elsewhere
from gfm.diagnosis.former.sisters import ALSO_GAIN, on_every_joint, on_other_joints, sisters_instead
from gfm.diagnosis.inference.fitting import (
    FITTING_S,
    LEAST_GAIN,
    ROUGH,
    Fit,
    at_bound,
    derivatives,
    each_left_out,
    fit,
    mean_square,
    nothing,
    orthonormal,
)
from gfm.diagnosis.residuals.problem import Problem, ringing_springs, settled, unsettled
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.naming import describe, first_of_each, twins
from gfm.diagnosis.search.screening import Screened, screen, shortlist, suspected
from gfm.effects import EffectInstance, Scales
from gfm.sim.plant import acts_on_command

#: Share of the best gain from which a candidate is a rival of the best.
RIVAL = 0.33
#: Rounds that are played at most.
MOST_ROUNDS = 6
#: Cost without an effect, to first order, in units of what is allowed, beyond which its being
#: superfluous is not looked into.
HARDLY = 1.5
#: Share of what is left from which on an effect need not prove itself on other recordings: no law
#: with a few parameters explains so much by chance.
OBVIOUS = 0.5
#: Mean square, in units of the bounded one, from which on outliers dominate it.
DOMINATED = 10.0
#: Candidates that are put to the test on other recordings in one round.
MOST_TESTED = 3
#: Cost at which a simpler effect is accepted before others are looked at, as a share of that
#: without it.
SUBSTANTIAL = 0.2
#: Mean squared residual, in units of the noise, that is much, and the share of it from which on the
#: best single effect explains little.
MUCH, HOPELESS = 100.0, 0.5
#: Times that states and amounts are looked for in turn at most, and the share of what was left that
#: one turn may leave for another: more comes from laws that are missing than from states.
IN_TURN, TURN_LEAVES, RINGING_LEAVES = 4, 0.2, 0.9
#: Times that several together are tried: what was worse than a single effect twice is not missing.
MOST_AT_ONCE = 2
#: Cost, as a multiple of the least, up to which fits that leave much are a close call.
CLOSE_CALL = 1.2
#: Rough fits that are fitted to the end: so many in front, if they are this close to the best.
POLISHED, CLOSE = 2, 1.5


@dataclass(frozen=True, kw_only=True)
class Round:
    """One round of attribution.

    Attributes:
        before: Cost without a new effect, on the recordings to which the shortlist is fitted.
        screened: Candidates by gain, best first.
        fits: The shortlist, fitted, best first; the new effect is the last of each fit's effects.
        accepted: The best of them, or None where it explains too little.
        together: How many new effects the first fit has, if none of them explains much alone.
        stretches: How many stretches it was about, those that stayed far off; 0 for all.
        restated: Whether what the model itself says was fitted anew.
        late_s: By how much later than predicted each answer to a step came before, and after, s,
            shape (A,) each; None where it was not about those.
        instead_of: What made way for the new effect.
    """

    before: float
    screened: tuple[Screened, ...]
    fits: tuple[Fit, ...]
    accepted: Fit | None
    together: int = 0
    stretches: int = 0
    restated: bool = False
    late_s: tuple[Array, Array] | None = None
    instead_of: EffectInstance | None = None

    @property
    def new(self) -> tuple[EffectInstance, ...]:
        """What the first fit has that others are compared with."""
        return self.fits[0].effects[-(self.together or 1) :]


@dataclass(frozen=True, kw_only=True)
class Attribution:
    """How a search went.

    Attributes:
        nominal_cost: Of the nominal model.
        fit: What was accepted in the end.
        rounds: First to last.
        stretches: That told of what acts now and then only.
        unsupported: What was accepted, but explains nothing that it was not fitted to.
        again: Rounds beside something that was taken out, played again beside what stayed.
    """

    nominal_cost: float
    fit: Fit
    rounds: tuple[Round, ...] = ()
    stretches: tuple[Problem, ...] = ()
    unsupported: tuple[EffectInstance, ...] = ()
    again: tuple[Round, ...] = ()

    def why_taken_out(self, instance: EffectInstance) -> str:
        """Returns why an accepted effect is not named in the end; nothing if it never was one."""
        fitted = self.fit.effects
        if instance.key in {e.key for e in (*fitted, *(twin for twin, _ in twins(fitted)))}:
            return "explains too little of the held-out recordings, with all that was found"
        if instance.key in {e.key for e in self.unsupported}:
            return "explains nothing on recordings that it was not fitted to"
        won = [this for this in self.rounds if this.accepted is not None]
        by = [this.new[0] for this in won if (e := this.instead_of) and e.key == instance.key]
        if by:
            return f"{describe(by[0])} gives nearly the same torque and explains more"
        if instance.key in {e.key for this in won for e in this.new}:
            return "superfluous beside what was found later"
        return ""


@dataclass(frozen=True, kw_only=True)
class InStretches:
    """What was found with what acts now and then only.

    Attributes:
        problem: In which the search takes place, with the stretches that told of it.
        fit: Of all effects, in this problem.
        rounds: In which it was found; none where nothing was.
        stretches: That told of it, round by round.
    """

    problem: Problem
    fit: Fit
    rounds: tuple[Round, ...] = ()
    stretches: tuple[Problem, ...] = ()


def attribute(
    problem: Problem,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    report: Callable[[str], None] = lambda _: None,
    at_once: Callable[[Problem, Sequence[EffectInstance]], Fit] | None = None,
    in_stretches: Callable[[Problem, Fit], InStretches] | None = None,
    begun: Attribution | None = None,
    torque_share: Callable[[Fit], float] = lambda _: 0.0,
) -> Attribution:
    """Returns which of `candidates` the recordings support, in which amounts.

    Args:
        problem: What is to be explained.
        candidates: What may explain it.
        scales: Of every joint's signals.
        report: Told what is happening, in words.
        at_once: Fits several effects together, beside others: where no single one explains much.
        in_stretches: Looks for what acts now and then only, beside what was found.
        begun: What was found so far in other stretches: the search goes on from there.
        torque_share: Which share of the missing torque the newest effect of a fit explains.
    """
    accepted = nothing(problem.robust(())) if begun is None else begun.fit
    problem = problem.robust(accepted.effects)
    nominal = accepted.cost if begun is None else begun.nominal_cost
    at_first = np.array([accepted.cost, *problem.joint_costs(accepted.residual)])
    rounds = [] if begun is None else list(begun.rounds)
    stretches: list[Problem] = []
    looked_beside: tuple[EffectInstance, ...] | None = None
    tries_at_once = MOST_AT_ONCE
    while len(rounds) < MOST_ROUNDS and not is_enough(problem, accepted, nominal):
        this = play_round(problem, candidates, scales, accepted, nominal, report, torque_share)
        together = any(r.together for r in rounds)
        if at_once is not None and tries_at_once and not together and hopeless(this):
            tries_at_once -= 1
            beside = _best(this, accepted).effects if rounds else ()
            this = _better(problem, this, accepted, at_once(problem, beside))
        if in_stretches is not None and _doubtful(this, accepted, looked_beside):
            # What acts now and then comes first: other effects would be bent to stand for it.
            seen = in_stretches(problem, accepted)
            problem, accepted, looked_beside = seen.problem, seen.fit, seen.fit.effects
            rounds.extend(seen.rounds)
            stretches.extend(seen.stretches)
            if seen.rounds:
                continue
        rounds.append(this)
        if this.accepted is None:
            break
        problem, accepted = settled_fit(problem, this.accepted.effects, nominal)
        accepted = with_level(problem, this.screened, accepted, report)
        if not is_enough(problem, accepted, nominal):
            accepted = on_other_joints(problem, this.screened, accepted, report)
    if len(accepted.effects) > 1:
        accepted = sisters_instead(problem, accepted, candidates, report)
        report("looking for what became superfluous")
        spared = not_judged(problem, accepted, nominal, rounds)
        accepted = without_superfluous(problem, accepted, spared, at_first)
    return Attribution(
        nominal_cost=nominal,
        fit=accepted,
        rounds=tuple(rounds),
        stretches=tuple(stretches),
    )


def settled_fit(
    problem: Problem, effects: Sequence[EffectInstance], nominal: float = 1.0
) -> tuple[Problem, Fit]:
    """Returns the problem with initial states that suit `effects`, and their fit to it.

    States and amounts are looked for in turn as long as that leaves far less each time; or less,
    where something rings: a little in its stiffness is much in how it began. Where much is left,
    the states that suited what was found before may be the reason: those measured are tried, too.

    Args:
        problem: What is to be explained.
        effects: With the amounts to begin with.
        nominal: Cost of the model without any.
    """
    problem = with_suitable_steps(problem, effects)
    there, found = _in_turn(problem, effects, nominal)
    if found.cost <= MUCH or all(s.measured is None for s in there.segments):
        return there, found
    begun = unsettled(there, found.effects)
    again = fit(begun, found.effects)
    if _unbounded(begun, again) > FAR_LESS * _unbounded(there, found):
        return there, found
    return _in_turn(begun, again.effects, nominal)


def _unbounded(problem: Problem, fitted: Fit) -> float:
    """Returns the cost of a fit if what is outlying counts in full."""
    return mean_square(replace(problem, outlying_from=None).residuals([fitted.effects])[0])


def _in_turn(
    problem: Problem, effects: Sequence[EffectInstance], nominal: float
) -> tuple[Problem, Fit]:
    """Returns initial states and amounts, each looked for anew where the other was found."""
    before = mean_square(problem.residuals([effects])[0])
    for _ in range(IN_TURN):
        problem = settled(problem, effects).robust(effects)
        found = fit(problem, effects)
        effects = found.effects
        leaves = RINGING_LEAVES if ringing_springs(problem, effects) else TURN_LEAVES
        if is_enough(problem, found, nominal) or found.cost > leaves * before:
            break
        before = found.cost
    return problem, found


def of_stretches(rounds: Sequence[Round]) -> list[tuple[object, ...]]:
    """Returns the keys of what was found by stretches in which it acts: nothing else judges it."""
    return [this.new[0].key for this in rounds if this.stretches]


def not_judged(
    problem: Problem, fitted: Fit, nominal: float, rounds: Sequence[Round]
) -> list[tuple[object, ...]]:
    """Returns the keys of what everything else may not judge: what was found by few stretches.

    None where nothing is left: what was needed shows there, and what only stood for an effect that
    was found later is superfluous wherever it was found.
    """
    return [] if is_enough(problem, fitted, nominal) else of_stretches(rounds)


def _doubtful(this: Round, before: Fit, looked_beside: tuple[EffectInstance, ...] | None) -> bool:
    """Returns whether stretches are to be looked into before a round counts.

    Where it found nothing, and once where it found nothing obvious; never twice beside the same.
    """
    if this.accepted is None:
        return before.effects != looked_beside
    return looked_beside is None and this.accepted.cost > (1.0 - OBVIOUS) * this.before


def hopeless(this: Round) -> bool:
    """Returns whether much is missing of which the best single effect explains little."""
    left = this.fits[0].cost if this.fits else this.before
    return this.before > MUCH and left > HOPELESS * this.before


def _better(problem: Problem, this: Round, before: Fit, other: Fit) -> Round:
    """Returns the round with `other` accepted instead, if that leaves far less."""
    best = _best(this, before).effects
    costs = np.mean(problem.residuals([best, other.effects]) ** 2, axis=1)
    more = len(other.effects) - len(before.effects)
    if not more or costs[1] > FAR_LESS * costs[0]:
        return this
    return replace(this, fits=(other, *this.fits), accepted=other, together=more)


def _best(this: Round, before: Fit) -> Fit:
    return before if this.accepted is None else this.accepted


def with_level(
    problem: Problem,
    screened: Sequence[Screened],
    accepted: Fit,
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Returns the fit with the level above which its newest effect comes, if that explains enough.

    An excess that was fitted alone stands for both and has left the valley of the true one, so that
    the level would explain little beside it: every start of the excess is tried again.
    """
    *before, newest = accepted.effects
    at = (newest.effect.excess_of, newest.joints)
    level = [c.instance for c in screened if c.instance.key == at]
    if not level:
        return accepted
    report(f"fitting {describe(newest)} beside {describe(level[0])}")
    part = problem.subset(problem.sample(FITTING_S))
    starts = [c.instance for c in screened if c.instance.key == newest.key]
    both = [fit(part, (*before, level[0], start), tolerance=ROUGH) for start in starts]
    best = min(both, key=lambda f: f.cost)
    alone = fit(part, accepted.effects, tolerance=ROUGH)
    parameters = len(level[0].effect.parameters)
    if best.cost < (1.0 - LEAST_GAIN * parameters) * alone.cost:
        return fit(problem, best.effects)
    return accepted


def without_superfluous(
    problem: Problem,
    accepted: Fit,
    kept: Collection[tuple[object, ...]] = (),
    at_first: Array | None = None,
) -> Fit:
    """Returns the fit without effects that explain too little beside those found after them.

    Nor those that have come to none, or to another bound. Those with the keys in `kept` stay.

    Args:
        problem: What is explained.
        accepted: By what.
        kept: Keys of effects that stay.
        at_first: What was left at first in all, and on each joint, shape (1 + J,). What other laws
            leave of it by their inexactness is too little, too: what stood for one that was found
            later makes up for that.
    """
    effects = accepted.effects
    while (fewer := _one_fewer(problem, effects, kept, at_first)) is not None:
        effects = fewer
    return accepted if effects == accepted.effects else fit(problem, effects)


def _one_fewer(
    problem: Problem,
    effects: tuple[EffectInstance, ...],
    kept: Collection[tuple[object, ...]],
    at_first: Array | None,
) -> tuple[EffectInstance, ...] | None:
    """Returns the effects without one that is not needed, fitted anew; None if all are needed."""
    needed = _allowed(problem, effects)
    for cost, instance in _without_one(problem, effects):
        if instance.key in kept:
            continue
        rest = tuple(one for one in effects if one is not instance)
        allowed = needed
        if at_first is not None and any(e.effect.abrupt and _same_place(e, instance) for e in rest):
            allowed = np.maximum(needed, 1.0 + INEXACT * (at_first - 1.0))
        if cost > HARDLY * allowed[0] and not _beside_lookalike(instance, effects):
            continue
        # From afar, where nearly all residuals are outlying, fits go astray: limits are set anew.
        without = fit(problem.robust(rest), rest, tolerance=ROUGH).effects
        own = [0, *(1 + problem.joints.index(name) for name in instance.joints)]
        if (_costs(problem, without)[own] < allowed[own]).all():
            return without
    return None


def _beside_lookalike(instance: EffectInstance, effects: Sequence[EffectInstance]) -> bool:
    """Returns whether something easily taken for an effect is there, too: it may take all over.

    How far it would get, first order does not tell.
    """
    alike = instance.effect.confused_with
    return any(e.effect.name in alike and _same_place(e, instance) for e in effects)


def _allowed(problem: Problem, effects: Sequence[EffectInstance]) -> Array:
    """Returns the costs up to which an effect is superfluous: in all, and on each joint.

    What was found for a joint with a small misfit is judged by that joint.
    """
    joints = len(problem.joints)
    share = np.array([LEAST_GAIN, *[ALSO_GAIN] * joints])
    seen = np.array([LEAST_SEEN / joints, *[LEAST_SEEN] * joints])
    costs = _costs(problem, effects)
    return np.asarray(np.maximum(costs / (1.0 - share), costs + seen))


def _costs(problem: Problem, effects: Sequence[EffectInstance]) -> Array:
    """Returns what effects leave in all, and on each joint, shape (1 + J,)."""
    residual = problem.residuals([effects])[0]
    return np.array([mean_square(residual), *problem.joint_costs(residual)])


def _without_one(
    problem: Problem, effects: tuple[EffectInstance, ...]
) -> list[tuple[float, EffectInstance]]:
    """Returns the cost of going without each effect, cheapest first.

    The others make up for it to first order.
    """
    rests, theirs = each_left_out(effects)
    jacobian = derivatives(problem.coarse(), effects, None)
    costs = []
    for columns, residual in zip(theirs, problem.residuals(rests), strict=True):
        basis = orthonormal(jacobian[:, columns])
        costs.append(mean_square(residual - basis @ (basis.T @ residual)))
    return sorted(zip(costs, effects, strict=True), key=lambda pair: pair[0])


def _same_place(one: EffectInstance, other: EffectInstance) -> bool:
    return not one.joints or not other.joints or bool(set(one.joints) & set(other.joints))


def play_round(
    problem: Problem,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    base: Fit,
    nominal: float,
    report: Callable[[str], None],
    torque_share: Callable[[Fit], float],
) -> Round:
    """Returns one round: screening, fits of the shortlist, and whether the best is accepted.

    Nothing is looked at where every joint is adequate: no effect could explain what it has to.
    What takes long to simulate is looked at only where nothing simpler explains much: if it is
    what is missing, it will be found beside the simpler effect and make that superfluous.
    """
    if (problem.joint_costs(base.residual) <= ADEQUATE_RATIO**2).all():
        return Round(before=base.cost, screened=(), fits=(), accepted=None)
    here = suspected(problem, candidates, base)
    report(f"screening {len(here)} candidates (misfit {base.cost:.2f})")
    part = problem.subset(problem.sample(FITTING_S))
    start = fit(part, base.effects)
    screened: list[Screened] = []
    fits: list[Fit] = []
    for costly in (False, True):
        tier = [place for place in here if place.effect.costly is costly]
        found = screen(problem, tier, scales, base)
        screened.extend(found)
        fits = polished(part, [*fits, *fit_best(part, found, start, report)])
        fits = _with_lookalikes(part, fits, found, start)
        if fits and _settles_it(part, fits[0], nominal, SUBSTANTIAL * start.cost):
            break
    screened.sort(key=lambda s: -s.gain)
    fits = _best_first(problem, fits, start, nominal, report, torque_share)
    this = Round(
        before=start.cost,
        screened=tuple(screened),
        fits=tuple(fits),
        accepted=fits[0] if fits else None,
    )
    if this.accepted is None:
        return this
    everywhere = on_every_joint(part, this.screened, this.accepted, start, nominal, report)
    return this if everywhere is None else _better(problem, this, start, everywhere)


def polished(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """Returns the fits, best first, those in front with all their parameters fitted to the end."""
    by_cost = sorted(fits, key=lambda f: f.cost)
    front = [f for f in by_cost[:POLISHED] if f.cost < CLOSE * by_cost[0].cost]
    done = [_fitted_out(problem, f.effects) for f in front]
    return sorted([*done, *by_cost[len(front) :]], key=lambda f: f.cost)


def _fitted_out(problem: Problem, effects: Sequence[EffectInstance]) -> Fit:
    """Returns the fit of effects, also from initial states of their own if that is better.

    Those of `problem` suit what was found before, and among close rivals that which changes least
    beside it.
    """
    as_it_is = fit(problem, effects)
    own = settled(problem, as_it_is.effects)
    if own.segments == problem.segments:
        return as_it_is
    return min(as_it_is, fit(own, as_it_is.effects), key=lambda f: f.cost)


def _with_lookalikes(
    problem: Problem, fits: list[Fit], screened: Sequence[Screened], start: Fit
) -> list[Fit]:
    """Returns the fits and, fitted to the end, what is easily taken for the best of them."""
    if not fits:
        return fits
    best = fits[0].effects[-1]
    tried = {f.effects[-1].key for f in fits}
    alike = [
        c.instance
        for c in screened
        if c.instance.effect.name in best.effect.confused_with
        and c.instance.key not in tried
        and _same_place(best, c.instance)
    ]
    more = [fit(problem, (*start.effects, instance)) for instance in alike[:1]]
    return sorted([*fits, *more], key=lambda f: f.cost)


def _best_first(
    problem: Problem,
    fits: list[Fit],
    start: Fit,
    nominal: float,
    report: Callable[[str], None],
    torque_share: Callable[[Fit], float],
) -> list[Fit]:
    """Returns the fits with one first that can be accepted, if there is one."""
    earned = [
        one
        for one in sorted(fits, key=_priced)
        if worth_it(problem, one, start)
        and not at_bound(one.effects[-1])
        and earns_its_states(problem, one, start)
    ]
    simplest = first_of_each(earned, lambda f: f.effects[-1].key)
    for tested in by_torque(simplest, torque_share)[:MOST_TESTED]:
        if not _settles_it(problem, tested, nominal, (1.0 - OBVIOUS) * start.cost):
            report(f"testing {describe(tested.effects[-1])} on other recordings")
            if not holds_elsewhere(problem, start.effects, tested.effects):
                continue
        return [tested, *(f for f in fits if f is not tested)]
    return []


def earns_its_states(problem: Problem, fitted: Fit, start: Fit) -> bool:
    """Returns whether the newest effect explains enough for the states that come with it.

    A motor that rings has two of its own in every stretch: they alone explain a part of whatever is
    missing.
    """
    brings_none = not ringing_springs(problem, fitted.effects[-1:])
    return brings_none or fitted.cost < (1.0 - OBVIOUS) * start.cost


def by_torque(fits: Sequence[Fit], torque_share: Callable[[Fit], float]) -> list[Fit]:
    """Returns fits, best first, those that are a close call by the torque that they explain.

    Where much is left, rollouts by a model that is wrong anyway tell nearly equal fits apart by
    chance. The missing torque is another witness.
    """
    if not fits or fits[0].cost < MUCH:
        return list(fits)
    level = CLOSE_CALL * _priced(fits[0])
    close = [f for f in fits if _priced(f) < level]
    far = [f for f in fits if _priced(f) >= level]
    return [*sorted(close, key=lambda f: -torque_share(f)), *far]


def _priced(fitted: Fit) -> float:
    """Returns the cost of a fit with what its newest effect has to explain at least."""
    return fitted.cost / (1.0 - price(fitted))


def _settles_it(problem: Problem, fitted: Fit, nominal: float, little: float) -> bool:
    """Returns whether a fit leaves nothing to explain, or little."""
    return fitted.cost < little or is_enough(problem, fitted, nominal)


def price(fitted: Fit) -> float:
    """Returns the share of the squared residual that the newest effect must explain at least.

    A number of periods counts, too: the best of many was looked for.
    """
    return LEAST_GAIN * len(fitted.effects[-1].effect.parameters)


def worth_it(problem: Problem, fitted: Fit, start: Fit) -> bool:
    """Returns whether the newest effect of a fit explains enough of what `start` leaves.

    In all, and of some joint's motion.
    """
    seen = problem.joint_costs(start.residual) - problem.joint_costs(fitted.residual)
    return fitted.cost < (1.0 - price(fitted)) * start.cost and bool(seen.max() >= LEAST_SEEN)


def fit_best(
    problem: Problem,
    screened: Sequence[Screened],
    base: Fit,
    report: Callable[[str], None],
) -> list[Fit]:
    """Returns the fitted shortlist: the best to first order, and its serious rivals."""
    fits: list[Fit] = []
    chosen = shortlist(screened)
    rivals = {c.instance.key for c in chosen if c.gain >= RIVAL * screened[0].gain}
    plain = replace(problem, outlying_from=None)
    from_afar = mean_square(plain.residuals([base.effects])[0]) > DOMINATED * base.cost
    for candidate in chosen:
        if candidate.instance.key not in rivals:
            continue
        report(f"fitting {describe(candidate.instance)}")
        effects = (*base.effects, candidate.instance)
        begun = [effects]
        if from_afar and candidate.instance.effect.valleys:
            # Where outliers hardly count, valleys are narrow; in squares they are wide.
            begun.append(fit(plain, effects, tolerance=ROUGH).effects)
        if problem.has_efforts and acts_on_command(candidate.instance):
            # An effort beside the command of its stamp jumps when a delay goes past it, and again
            # at every command before; a position does not.
            begun.append(fit(problem.positions_alone(), effects, tolerance=ROUGH).effects)
        fits += [fit(problem, one, known=base.jacobian, tolerance=ROUGH) for one in begun]
    return fits
