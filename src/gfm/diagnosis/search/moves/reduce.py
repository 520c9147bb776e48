"""Remove what a hypothesis predicts as well without, and exchange what something else says better.

What came first was chosen while others were missing, and may stand for them, too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from gfm.diagnosis.inference.amounts import amounts, at_bound, with_amounts
from gfm.diagnosis.inference.fitting import Fit, measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P, parameters_of
from gfm.diagnosis.search.moves.add import takes_long
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.read_off import looks_like
from gfm.diagnosis.search.screening import goes_beside, is_whole, screen
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Key

#: Recorded time on which rivals of an effect are looked at, s, and how many are fitted.
RIVALS_S, RIVALS = 12.0, 2


def remove(here: Hypothesis[P], search: Search[P]) -> Hypothesis[P]:
    """Returns a hypothesis without what it predicts as well without, that first which says least.

    As well: to within one standard error (Breiman et al. 1984). As with all effects: what each
    leaves little worse, together would leave much worse. What a few segments judge stays. What is
    not removed in time has little to speak for it.
    """
    whole = here
    while len(here.effects) > 1:
        removals = _removals(here, whole, search.held)
        step = search.in_its_time(partial(next, removals, None), None)
        if step is None or step.chosen is None:
            break
        search.report(f"going on without {', '.join(map(describe, step.replaced))}")
        search.steps.append(step)
        here = replace(here, fit=step.chosen.fit)
    return here if here is whole else search.led_to(here, search.steps[-1])


def _removals(here: Hypothesis, whole: Hypothesis, kept: Collection[Key]) -> Iterator[Step]:
    """Yields the steps that take out what says little to first order: several, then one by one.

    That first which says least. What says little alone may say much beside what goes with it.
    """
    gains, effects = [gain for gain, _ in gains_of_each(here)], here.effects
    little = [i for i, e in enumerate(effects) if at_bound(e) or not gains[i].notable]
    least = sorted(little, key=lambda i: gains[i].errors)
    least = [i for i in least if effects[i].key not in kept]
    halves = [least[: len(least) >> times] for times in range(len(least).bit_length() - 1)]
    losses = zip(halves, here.over_less(halves), strict=True)
    several = [gone for gone, loss in losses if not loss.notable]
    for gone in (*several, *([i] for i in least)):
        if not (rest := [e for i, e in enumerate(effects) if i not in gone]):
            continue
        new, without = tuple(effects[i] for i in gone), here.fitted(rest)
        worse = here.over(without).notable or whole.over(without).notable
        if not worse or all(map(at_bound, new)):
            tried = Tried(new=new, fit=without, gain=-here.over(without))
            yield Step(move=Move.REMOVE, before=here.fit.cost, chosen=tried, replaced=new)


def gains_of_each(here: Hypothesis) -> list[tuple[Difference, EffectInstance]]:
    """Returns by how much a hypothesis predicts better than without each of its effects."""
    gains = here.over_less([[i] for i in range(len(here.effects))])
    return list(zip(gains, here.effects, strict=True))


#: Returns fits of the rivals of an effect, each behind the rest of a hypothesis.
RivalsOf: TypeAlias = Callable[[EffectInstance, Hypothesis[P], Search[P]], Sequence[Fit]]


def rivals_of(instance: EffectInstance, rest: Hypothesis[P], search: Search[P]) -> list[Fit]:
    """Returns fits of the best rivals of an effect among candidates, beside all others.

    What was weighed beside it in its step rivals it, too, and so does the best motor apart from its
    link: no step weighs those beside what is simulated quickly.
    """
    taken = {instance.key, *(e.key for e in rest.effects)}
    steps = [
        step
        for step in search.steps
        if step.chosen is not None and instance.key in {e.key for e in step.chosen.new}
    ]
    known = [tried.new[0] for step in steps for tried in step.ranked if len(tried.new) == 1]
    found = [one for one in known if one.key not in taken and goes_beside(rest, one)]
    alike = [
        place
        for place in search.candidates
        if place.key not in taken
        and goes_beside(rest, place)
        and (_near(place, instance) or _does_the_same(place, instance, rest, search))
    ]
    motors = [p for p in alike if p.effect.separates_motor]
    # Beside the effect nearly all that the rest leaves is outlying: first order would say nothing.
    problem = rest.problem.robust(rest.effects)
    alone = replace(rest, problem=problem, fit=measured(problem, rest.effects))
    # Rivals of then stood beside other effects, or were those that the missing torque showed.
    if rest.effects or not any(step.move is Move.ADD for step in steps):
        quick = [p for p in alike if p not in motors]
        found = [one.instance for one in screen(alone, quick, RIVALS_S)] + found
    best = first_of_each(found, lambda one: one.key)[:RIVALS]
    best += [one.instance for one in screen(alone, motors, RIVALS_S)[:1] if one.gain.notable]
    return [rest.fitted((*rest.effects, rival)) for rival in best]


def _near(place: Place, instance: EffectInstance) -> bool:
    """Returns whether a candidate may be taken for an effect: on its joints, or of the whole robot.

    What takes long to simulate is no rival of what does not: see `_does_the_same`.
    """
    effect = place.effect
    costly = takes_long(effect) and not effect.separates_motor
    here = place.joints == instance.joints or is_whole(effect)
    like = effect.name in instance.effect.confused_with
    return (here and not costly) or (like and (here or is_whole(instance.effect)))


def _does_the_same(
    place: Place, instance: EffectInstance, rest: Hypothesis[P], search: Search[P]
) -> bool:
    """Returns whether what takes long to simulate adds nearly the torque that an effect adds."""
    if search.torques is None or not place.effect.costly or place.joints != instance.joints:
        return False
    return looks_like(search.torques, place, instance, rest.effects)


@dataclass(frozen=True, kw_only=True)
class Compared:
    """An effect and the best in its place.

    Attributes:
        instance: The effect.
        rival: The hypothesis with the best rival in its place; None where nothing rivals it.
        more: How many parameters that has more than the effect.
        weighed: Whether there was time for its rivals.
        equals: What predicts the very same in its place: other names of it, here.
    """

    instance: EffectInstance
    rival: Tried | None = None
    more: int = 0
    weighed: bool = True
    equals: tuple[EffectInstance, ...] = ()

    @property
    def better(self) -> bool:
        """Whether the rival takes the place: it predicts better, or as well and is simpler.

        As well is to within one error; better is by more than that, of more parameters clearly.
        """
        if self.rival is None or any(map(at_bound, self.rival.new)):
            return False
        gain = self.rival.gain
        if self.more > 0:
            return gain.clear
        return gain.notable if self.more == 0 else not (-gain).notable


def _compared(
    here: Hypothesis[P], instance: EffectInstance, rivals: RivalsOf[P], search: Search[P]
) -> Compared:
    """Returns an effect of a hypothesis beside the best of its rivals.

    What has more parameters has to predict better by more than chance: it can do more. Each is
    weighed in its simplest form: a tilt in the plane of an arm is one number, not two.
    """
    others = tuple(e for e in here.effects if e is not instance)
    fits = rivals(instance, replace(here, fit=here.fitted(others)), search)
    simple = [simplest(here, one) for one in fits]
    tried = [Tried(new=f.effects[-1:], fit=f, gain=-here.over(f)) for f in simple]
    count = parameters_of([instance], here.fit)
    as_simple = [one for one in tried if one.parameters <= count or one.gain.notable]
    pair = _beside_best(instance, as_simple, count)
    if pair.rival is None or pair.better or not _not_told_apart(instance, pair.rival):
        return pair
    names = tuple(one.new[0] for one in as_simple if _not_told_apart(instance, one))
    different = [one for one in as_simple if not _not_told_apart(instance, one)]
    return replace(_beside_best(instance, different, count), equals=names)


def _not_told_apart(instance: EffectInstance, rival: Tried) -> bool:
    """Returns whether a rival is another name of an effect, here: they are named together.

    It predicts the very same, or it is known to be confused with it and the data do not decide.
    """
    first, second = instance.effect, rival.new[0].effect
    alike = second.name in first.confused_with or first.name in second.confused_with
    return rival.gain.same or (alike and rival.gain.open)


def _beside_best(instance: EffectInstance, rivals: Sequence[Tried], count: int) -> Compared:
    """Returns an effect that has `count` parameters beside the best of some rivals."""
    best = max(rivals, key=lambda one: one.gain.nats, default=None)
    more = best.parameters - count if best else 0
    return Compared(instance=instance, rival=best, more=more)


def simplest(here: Hypothesis, rival: Fit) -> Fit:
    """Returns a rival without those of its numbers without which it predicts as well.

    As well: to within one standard error, as where effects are removed. They are nought and stay
    there: their derivatives are nought, too.
    """
    own = np.flatnonzero(rival.owners == len(rival.effects) - 1)
    for column in own if len(own) > 1 else ():
        values, jacobian = amounts(rival.effects), rival.jacobian.copy()
        values[column], jacobian[:, column] = 0.0, 0.0
        effects = with_amounts(rival.effects, values)
        if not effects[-1].effect.admissible(effects[-1].values):
            continue
        residual = here.problem.residuals([effects])[0]
        without = Fit(effects=effects, jacobian=jacobian, residual=residual)
        if not replace(here, fit=rival).over(without).notable:
            rival = without
    return rival


def exchange(
    here: Hypothesis[P], search: Search[P], rivals: RivalsOf[P] = rivals_of
) -> tuple[Hypothesis[P], list[Compared]]:
    """Returns a hypothesis with what rivals say better, and every effect's best rival.

    What made way for another does not come back, or two could replace each other for ever; and what
    a few segments judge stays.
    """
    told: list[Compared] = []
    exchanged = [step for step in search.steps if step.move is Move.EXCHANGE]
    gone = {one.key for step in exchanged for one in step.replaced}
    for key in [e.key for e in here.effects]:
        instance = next((e for e in here.effects if e.key == key), None)
        if instance is None or key in search.held:
            continue
        pair = Compared(instance=instance, weighed=False)
        if search.in_time():
            search.report(f"looking for rivals of {describe(instance)}")
            compared = partial(_compared, here, instance, rivals, search)
            pair = search.in_its_time(compared, pair)
        if pair.rival and pair.better and pair.rival.new[0].key not in gone:
            gone.add(key)
            step = Step(
                move=Move.EXCHANGE,
                before=here.fit.cost,
                ranked=(pair.rival,),
                chosen=pair.rival,
                replaced=(instance,),
            )
            search.steps.append(step)
            here = search.led_to(here, step)
        else:
            told.append(pair)
    return here, told
