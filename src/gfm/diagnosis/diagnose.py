"""From recordings to a verdict: the whole chain, in the order in which a reader will follow it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis import evidence
from gfm.diagnosis.attribution import (
    ADEQUATE,
    Attribution,
    Round,
    attribute,
    describe,
    price,
)
from gfm.diagnosis.candidates import joint_scales, places, torque_views
from gfm.diagnosis.chain import evidence_chain
from gfm.diagnosis.correction import corrected_model
from gfm.diagnosis.fitting import Fit, along_valley, fit, free_parameters
from gfm.diagnosis.intervals import half_widths
from gfm.diagnosis.learned import learned_report
from gfm.diagnosis.naming import fitly_named, twins
from gfm.diagnosis.objects import ObjectPart, examine_object, widened
from gfm.diagnosis.problem import (
    LONG,
    WHOLE,
    Problem,
    all_stretches,
    check_recordings,
    make_problem,
    settled,
)
from gfm.diagnosis.quality import all_findings, doubts
from gfm.diagnosis.result import (
    Diagnosis,
    ErrorSummary,
    EvidencePlot,
    JointError,
    NamedEffect,
    ParameterEstimate,
    RecordingSummary,
    Suspect,
    Verdict,
)
from gfm.diagnosis.stretches import look_into_stretches
from gfm.diagnosis.usual import usually_missing
from gfm.effects import EffectInstance, Scope, effect_library
from gfm.excitation.blind_spots import blind_spots
from gfm.sim.learned import LearnedForces
from gfm.sim.plant import native_spec

#: Held-out RMSE, in units of the sensor noise, up to which a nominal model counts as adequate.
ADEQUATE_RATIO = 1.25
#: The same for a corrected one, and for what is claimed of one effect, where it acts; and the share
#: of the gap there that abrupt laws, which are not quite exact, may leave: what leaves more stands,
#: perhaps, for something that no known effect describes.
CREDIBLE_RATIO, INEXACT_SHARE = 1.5, 0.003
#: More noise floors than this are left by something else than inexact laws.
FAR_FROM_NOISE = 20.0
#: Share of the held-out gap that abrupt laws must close to call it explained although some is left.
EXPLAINED_SHARE = 0.99
#: Share of the gap that has to be closed to name anything.
LEAST_SHARE = 0.05
#: Less motion or time than this says nothing about dynamics.
LEAST_MOTION_RAD, LEAST_TIME_S, LEAST_RATE_HZ = 0.01, 1.5, 10.0
#: Recorded time in which effects are looked for (of an arm; of smaller robots more).
LOOKED_AT_S = 72.0
#: Recorded time on which the profiles of amounts are drawn (of an arm; of smaller robots more).
PROFILED_S = 12.0
#: Two candidates are equal when the runner-up leaves so little more of what the best explains.
EQUAL, CLEAR = 0.01, 0.10
#: How sure one may be, by the ratio of the runner-up's cost to that of a best that leaves noise.
WORSE = ((1.0, 1.02, 1.1, 1.5), (0.5, 0.6, 0.9, 0.99))


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Held-out errors of the nominal and the corrected model, per segment (T, J), rad."""

    problem: Problem
    before: list[Array]
    after: list[Array]

    @property
    def by_joint(self) -> dict[str, ErrorSummary]:
        """Returns the same three numbers of every joint."""
        both = evidence.rmse(self.before), evidence.rmse(self.after)
        rows = zip(self.problem.joints, *both, self.problem.noise.position, strict=True)
        return {
            joint: ErrorSummary(before=float(b), after=float(a), noise_floor=float(n))
            for joint, b, a, n in rows
        }

    @property
    def summary(self) -> ErrorSummary:
        """Returns the three numbers of the verdict."""
        return ErrorSummary(
            before=_overall(self.before),
            after=_overall(self.after),
            noise_floor=float(np.sqrt(np.mean(self.problem.noise.position**2))),
        )


def _errors(problem: Problem, effects: Sequence[EffectInstance]) -> HeldOut:
    """Returns the errors of the nominal model and of that with `effects`."""
    return HeldOut(
        problem=problem,
        before=settled(problem, ()).position_errors(()),
        after=settled(problem, effects).position_errors(effects),
    )


def diagnose(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    holdout: Sequence[Trajectory],
    *,
    report: Callable[[str], None] = lambda _: None,
    provenance: Mapping[str, object] | None = None,
    notes: Sequence[str] = (),
    given: Sequence[EffectInstance] = (),
    learned: Sequence[LearnedForces] = (),
) -> Diagnosis:
    """Returns what `specs` lack to explain `recordings`, judged on `holdout`.

    Args:
        specs: The nominal model by the kind of command that its actuators take.
        recordings: What effects are looked for in and fitted to.
        holdout: What errors are measured on; never looked at before.
        report: Told what is happening, in words.
        provenance: What the result should say about where it came from.
        notes: Remarks of the caller that a reader should see.
        given: Effects of the nominal model that `specs` cannot say.
        learned: Forces that were fitted to recordings under the nominal model, to be named, too.

    Raises:
        BadInputError: recordings, models and forces do not belong together.
    """
    check_recordings(specs, [*recordings, *holdout])
    thing = examine_object(specs[recordings[0].command_kind], recordings, holdout, report)
    pushed = _pushed(thing)
    specs = {kind: _with_cone(spec, thing) for kind, spec in specs.items()}
    beside = {
        kind: native_spec(spec, [e.instance() for e in pushed]) for kind, spec in specs.items()
    }
    report("measuring the nominal model")
    problem = make_problem(beside, recordings, given=given, most_s=LOOKED_AT_S)
    long = make_problem(
        beside, recordings, problem.noise, given=given, windows_s=LONG, most_s=LOOKED_AT_S
    )
    held = make_problem(beside, holdout, problem.noise, given=given, windows_s=WHOLE)
    told = learned_report(long, recordings, learned) if learned else None
    lack = _lacking(recordings)
    found, fitted_to = None, long
    if not lack:
        everything = all_stretches(beside, recordings, problem.noise, given=given)
        found, fitted_to = _attribute(problem, long, everything, recordings, report)
    instances = found.fit.effects if found else ()
    report("measuring the corrected model on held-out recordings")
    errors = _errors(held, instances)
    if found and _closed(errors.summary) < LEAST_SHARE:
        instances, errors = (), HeldOut(problem=held, before=errors.before, after=errors.before)
    named = (
        _named(fitted_to.slices(), found, instances, errors.summary, errors.by_joint)
        if found
        else ()
    )
    verdict = Verdict.INSUFFICIENT_DATA if lack else _verdict(errors.summary, named)
    both = (*named, *pushed)
    corrected = {kind: corrected_model(spec, both, given) for kind, spec in specs.items()}
    first = corrected[recordings[0].command_kind]
    findings = all_findings(long, recordings, holdout, instances)
    robot = Diagnosis(
        verdict=verdict,
        sentence=_sentence(verdict, named, errors.summary, lack),
        effects=named,
        suspects=_suspects(found, instances) if found else (),
        error=errors.summary,
        joints=_joint_errors(errors),
        recordings=tuple(
            replace(row, warnings=doubts(findings, row.name))
            for row in _inputs(long, recordings, errors, holdout, instances)
        ),
        findings=findings,
        blind_spots=blind_spots(recordings),
        corrected_xml=first.xml,
        corrected_effects=first.effects,
        twins=corrected if len(corrected) > 1 else {},
        chain=evidence_chain(held, holdout, found, instances, (errors.before, errors.after)),
        gfm=told,
        plots=_plots(problem, found.stretches if found else (), recordings, instances, errors),
        notes=(*notes, *doubts(findings), *_notes(verdict, outside=bool(first.effects))),
        provenance=dict(provenance or {}),
    )
    return _with_object(robot, thing, pushed) if thing else robot


def _pushed(thing: ObjectPart | None) -> tuple[NamedEffect, ...]:
    """Returns what the object lacks, if that explains more than next to nothing."""
    if thing is None or _closed(thing.overall) < LEAST_SHARE:
        return ()
    named = _named(thing.problem.slices(), thing.found, thing.effects, thing.overall)
    return tuple(widened(one) for one in named)


def _with_cone(spec: mujoco.MjSpec, thing: ObjectPart | None) -> mujoco.MjSpec:
    """Returns the model with the kind of contacts under which the object is explained best."""
    if thing is None or int(spec.option.cone) == thing.cone:
        return spec
    changed = spec.copy()
    changed.option.cone = thing.cone
    return changed


def _with_object(robot: Diagnosis, thing: ObjectPart, pushed: tuple[NamedEffect, ...]) -> Diagnosis:
    """Returns the answer on robot and object together."""
    return replace(
        robot,
        verdict=_of_both(robot.verdict, _verdict(thing.overall, pushed)),
        sentence=f"{robot.sentence} {_object_sentence(thing, pushed)}",
        effects=(*robot.effects, *pushed),
        suspects=(*robot.suspects, *_suspects(thing.found, thing.effects if pushed else ())),
        object_error=dict(zip(("position", "yaw"), thing.errors, strict=True)),
        blind_spots=(*robot.blind_spots, *thing.blind_spots),
        plots=(*robot.plots, *thing.plots),
        notes=(*robot.notes, *thing.notes),
    )


def _of_both(robot: Verdict, thing: Verdict) -> Verdict:
    """Returns the verdict on the robot and the object together."""
    if robot in (thing, Verdict.INSUFFICIENT_DATA) or thing is Verdict.NO_GAP:
        return robot
    return thing if robot is Verdict.NO_GAP else Verdict.PARTLY_EXPLAINED


def _object_sentence(thing: ObjectPart, pushed: Sequence[NamedEffect]) -> str:
    place = thing.errors[0]
    names = "; ".join(_in_words(effect) for effect in pushed)
    lacks = (
        f"misses {names} of the object" if pushed else "misses nothing of the object with a name"
    )
    return (
        f"It {lacks} (held-out error of its place {place.before:.3g} m before, "
        f"{place.after:.3g} m after, noise {place.noise_floor:.3g} m)."
    )


def _lacking(recordings: Sequence[Trajectory]) -> str:
    """Returns why nothing can be said about dynamics, or an empty text."""
    moved = max(float(np.ptp(r.position, axis=0).max()) for r in recordings)
    time_s = sum(r.duration_s for r in recordings)
    rate_hz = min(1.0 / float(np.median(np.diff(r.time_s))) for r in recordings)
    if moved < LEAST_MOTION_RAD:
        return f"no joint moves by more than {moved:.4f} rad"
    if time_s < LEAST_TIME_S:
        return f"only {time_s:.2f} s were recorded"
    if rate_hz < LEAST_RATE_HZ:
        return f"{rate_hz:.1f} measurements per second are too few"
    return ""


def _attribute(
    problem: Problem,
    long: Problem,
    everything: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
) -> tuple[Attribution, Problem]:
    """Returns what recordings support, and that to which its amounts were fitted.

    Found in short stretches, and in those that stay far off; amounts are settled in long ones.
    """
    report("looking at torques")
    scales = joint_scales(problem, torque_views(problem, recordings))
    looked_for = [effect for effect in effect_library().values() if effect.twin is None]
    candidates = [place for effect in looked_for for place in places(effect, problem.joints)]
    always = [place for place in candidates if not place.effect.only_in_stretches]
    at_once = partial(usually_missing, scales=scales, report=report)
    in_stretches = partial(
        look_into_stretches,
        everything=everything,
        candidates=candidates,
        scales=scales,
        report=report,
    )
    found = attribute(problem, always, scales, report, at_once, in_stretches)
    report("settling amounts")
    long = reduce(Problem.joined, found.stretches, long)
    effects = found.fit.effects
    long_settled = settled(long, effects).robust(effects)
    final = fit(long_settled, effects)
    if final.cost > ADEQUATE:
        final = along_valley(long_settled, final)
    return replace(found, fit=fitly_named(final, problem.specs)), long


def _closed(error: ErrorSummary) -> float:
    """Returns the share of the held-out gap (squared error above the noise) that was closed."""
    gap = error.before**2 - error.noise_floor**2
    return 0.0 if gap <= 0.0 else (error.before**2 - error.after**2) / gap


def _verdict(error: ErrorSummary, named: Sequence[NamedEffect]) -> Verdict:
    if not named:
        adequate = error.before <= ADEQUATE_RATIO * error.noise_floor
        return Verdict.NO_GAP if adequate else Verdict.UNEXPLAINED
    abrupt = any(effect_library()[one.effect].abrupt for one in named)
    if credible([error], abrupt=abrupt, share=EXPLAINED_SHARE):
        return Verdict.EXPLAINED
    return Verdict.PARTLY_EXPLAINED


def _named(
    blocks: Sequence[slice],
    found: Attribution,
    instances: Sequence[EffectInstance],
    error: ErrorSummary,
    by_joint: Mapping[str, ErrorSummary] | None = None,
) -> tuple[NamedEffect, ...]:
    """Returns the accepted effects with intervals, in the order in which they were found.

    Args:
        blocks: Rows of the fit's residual that belong together.
        found: What was accepted, and when.
        instances: The same with their amounts.
        error: Held-out, of everything together.
        by_joint: The same of every joint.
    """
    if not instances:
        return ()
    fitted = found.fit
    free = free_parameters(instances)
    values = np.array([instances[i].values[name] for i, name in free])
    widths = half_widths(values, fitted.jacobian, fitted.residual, blocks)
    by_place = dict(zip(free, widths, strict=True))
    abrupt = any(instance.effect.abrupt for instance in instances)
    named = []
    for i, instance in enumerate(instances):
        parameters = {}
        here = [error, *_where_it_acts(instance, by_joint or {})]
        adequate = all(one.after <= CREDIBLE_RATIO * one.noise_floor for one in here)
        for p in instance.effect.parameters:
            value, width = instance.values[p.name], float(by_place.get((i, p.name), np.inf))
            holds = adequate and not instance.effect.only_in_stretches
            parameters[p.name] = _estimate(value, p.unit, width, holds=holds)
        named.append(
            NamedEffect(
                effect=instance.effect.name,
                joints=instance.joints,
                parameters=parameters,
                confidence=_confidence(
                    _found_in(instance, found.rounds), error, adequate=credible(here, abrupt=abrupt)
                ),
                native=instance.effect.native,
            )
        )
    return tuple(named)


def _estimate(value: float, unit: str, width: float, *, holds: bool) -> ParameterEstimate:
    """Returns a value with its interval, or with its spread where no interval would hold."""
    if not np.isfinite(width):
        return ParameterEstimate(value=value, unit=unit, ci95=None)
    if not holds:
        return ParameterEstimate(value=value, unit=unit, ci95=None, spread=width)
    return ParameterEstimate(value=value, unit=unit, ci95=(value - width, value + width))


def _where_it_acts(
    instance: EffectInstance, by_joint: Mapping[str, ErrorSummary]
) -> list[ErrorSummary]:
    """Returns the errors of the joints on which an effect acts: all, unless it is of some."""
    local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
    return [one for joint, one in by_joint.items() if not local or joint in instance.joints]


def credible(
    errors: Sequence[ErrorSummary], *, abrupt: bool, share: float = 1.0 - INEXACT_SHARE
) -> bool:
    """Returns whether noise is left, by all of `errors`.

    Beside an `abrupt` law also where that share of the gap was closed. Smooth laws are simulated
    exactly: what they leave, they do not describe.
    """
    return all(
        one.after <= CREDIBLE_RATIO * one.noise_floor or (abrupt and _left_little(one, share))
        for one in errors
    )


def _left_little(error: ErrorSummary, share: float) -> bool:
    """Returns whether that share of the gap was closed, and what is left is not far from noise."""
    return _closed(error) >= share and error.after <= FAR_FROM_NOISE * error.noise_floor


def clearness(fits: Sequence[Fit], before: float, *, adequate: bool) -> float:
    """Returns how clearly the first of `fits` is better than its runner-up, 0.5..0.99.

    By the share of what was missing that only the best explains. Where what is left in the end is
    noise, a runner-up that leaves more than the best is worse, however small that share is. What
    explains as much with more parameters (a spring far from its rest, instead of a constant torque)
    is no rival.

    Args:
        fits: The best first.
        before: Cost without any of them.
        adequate: Whether what is left in the end is noise.
    """
    best = fits[0]
    costs = [
        f.cost
        for f in fits
        if f.effects[-1].key != best.effects[-1].key and price(f) <= price(best)
    ]
    if not costs:
        return 0.99
    share = (min(costs) - best.cost) / max(before - best.cost, 1e-9)
    clear = float(np.interp(share, [0.0, EQUAL, CLEAR, 1.0], [0.5, 0.6, 0.95, 0.99]))
    worse = float(np.interp(min(costs) / best.cost, *WORSE))
    return max(clear, worse) if adequate else clear


def _found_in(instance: EffectInstance, rounds: Sequence[Round]) -> Round:
    """Returns the round in which an effect was accepted, there or first on another joint.

    A level came with its excess.
    """
    names = {instance.effect.name, *(twin.effect.name for twin, _ in twins([instance]))}
    names |= {e.name for e in effect_library().values() if e.excess_of == instance.effect.name}
    won = [r for r in rounds if r.accepted is not None]
    alike = [(r, e) for r in won for e in r.new if e.effect.name in names]
    here = [r for r, e in alike if e.joints == instance.joints]
    return (here or [r for r, _ in alike])[0]


def _confidence(this: Round, error: ErrorSummary, *, adequate: bool) -> float:
    """Returns 0..1: high where the runner-up explains clearly less and only noise is left.

    Half where the runner-up explains as much. Half at most where more than noise is left: what is
    named may then stand for something that no known effect describes.
    """
    clear = clearness(this.fits, this.before, adequate=adequate)
    closed = np.clip(_closed(error), 0.0, 1.0)
    return round(float(clear * (1.0 if adequate else 0.5 * closed)), 3)


def _suspects(found: Attribution, instances: Sequence[EffectInstance]) -> tuple[Suspect, ...]:
    """Returns the candidates that were fitted and lost, by the round in which they did best."""
    taken = {instance.key for instance in instances} | {t.key for t, _ in twins(instances)}
    best: dict[tuple[str, tuple[str, ...]], Suspect] = {}
    for this in found.rounds:
        for fitted in this.fits:
            instance = fitted.effects[-1]
            gain = 1.0 - fitted.cost / this.before
            if instance.key in taken or gain < 0.01 or instance.key in best:
                continue
            best[instance.key] = Suspect(
                effect=instance.effect.name,
                joints=instance.joints,
                reason=_reason(fitted, this),
                decided_by=instance.effect.shown_by,
                gain=float(np.clip(gain, 0.0, 1.0)),
            )
    equal = [
        Suspect(
            effect=twin.effect.name,
            joints=twin.joints,
            reason=f"equal to {describe(instance)}: the same torque under another name",
            decided_by=twin.effect.shown_by,
            gain=_gain_of(twin, instance, found),
        )
        for twin, instance in twins(instances)
    ]
    return (*equal, *sorted(best.values(), key=lambda s: -s.gain))


def _gain_of(twin: EffectInstance, instance: EffectInstance, found: Attribution) -> float:
    """Returns the share of the squared residual that an effect explained when it was accepted."""
    keys = (twin.key, instance.key)
    gains = [
        1.0 - this.fits[0].cost / this.before
        for this in found.rounds
        if this.fits and this.fits[0].effects[-1].key in keys
    ]
    return float(np.clip(max(gains, default=0.0), 0.0, 1.0))


def _reason(fitted: Fit, this: Round) -> str:
    winner, share = this.fits[0], 100.0 * (1.0 - fitted.cost / this.before)
    if winner is fitted or this.accepted is None:
        return f"explains only {share:.1f} % of the squared residual"
    gap = (fitted.cost - winner.cost) / max(this.before - winner.cost, 1e-9)
    rival = "several effects together" if this.together else describe(winner.effects[-1])
    explains = "explain" if this.together else "explains"
    if gap < EQUAL:
        return f"equal to {rival}: both explain {share:.1f} % of the squared residual"
    best = 100.0 * (1.0 - winner.cost / this.before)
    return f"explains {share:.1f} % of the squared residual; {rival} {explains} {best:.1f} %"


def _sentence(
    verdict: Verdict, named: Sequence[NamedEffect], error: ErrorSummary, lack: str
) -> str:
    if verdict is Verdict.INSUFFICIENT_DATA:
        return f"The recordings do not say enough about the dynamics: {lack}."
    figures = (
        f"held-out position error {error.before:.3g} rad before, {error.after:.3g} rad after, "
        f"sensor noise {error.noise_floor:.3g} rad"
    )
    if verdict is Verdict.NO_GAP:
        return f"The model explains the recordings to within the sensor noise ({figures})."
    if verdict is Verdict.UNEXPLAINED:
        return f"The model misses something that no known effect explains ({figures})."
    names = "; ".join(effects_in_words(named))
    part = "misses" if verdict is Verdict.EXPLAINED else "misses, among what stays unexplained,"
    return f"The model {part} {names} ({figures})."


def effects_in_words(named: Sequence[NamedEffect]) -> list[str]:
    """Returns the effects in words, those of one kind on several joints as one."""
    kinds: dict[str, list[NamedEffect]] = {}
    for effect in named:
        kinds.setdefault(effect.effect, []).append(effect)
    return [_in_words(alike[0]) if len(alike) == 1 else _of_kind(alike) for alike in kinds.values()]


def _of_kind(alike: Sequence[NamedEffect]) -> str:
    first = alike[0]
    joints = ", ".join(joint for effect in alike for joint in effect.joints)
    ranges = []
    for name, parameter in first.parameters.items():
        values = [effect.parameters[name].value for effect in alike]
        unit = "" if parameter.unit == "1" else parameter.unit
        ranges.append(
            f"{name.replace('_', ' ')} {min(values):.3g} to {max(values):.3g} {unit}".rstrip()
        )
    return f"{first.effect.replace('_', ' ')} on {joints} ({', '.join(ranges)})"


def _in_words(effect: NamedEffect) -> str:
    where = f" on {', '.join(effect.joints)}" if effect.joints else ""
    amounts = ", ".join(
        f"{name.replace('_', ' ')} {p.value:.4g} {'' if p.unit == '1' else p.unit}".rstrip()
        for name, p in effect.parameters.items()
    )
    return f"{effect.effect.replace('_', ' ')}{where} ({amounts})"


def _joint_errors(errors: HeldOut) -> tuple[JointError, ...]:
    return tuple(
        JointError(joint=joint, before=one.before, after=one.after, noise_floor=one.noise_floor)
        for joint, one in errors.by_joint.items()
    )


def _inputs(
    problem: Problem,
    recordings: Sequence[Trajectory],
    errors: HeldOut,
    holdout: Sequence[Trajectory],
    instances: Sequence[EffectInstance],
) -> tuple[RecordingSummary, ...]:
    training = _errors(problem, instances)
    return (
        *_rows(recordings, training, "training"),
        *_rows(holdout, errors, "held-out"),
    )


def _rows(recordings: Sequence[Trajectory], errors: HeldOut, role: str) -> list[RecordingSummary]:
    rows = []
    for i, recording in enumerate(recordings):
        here = [k for k, s in enumerate(errors.problem.segments) if s.recording == i]
        rows.append(
            RecordingSummary(
                name=recording.name,
                role=role,
                command=str(recording.command_kind),
                duration_s=recording.duration_s,
                rate_hz=1.0 / float(np.median(np.diff(recording.time_s))),
                before=_overall([errors.before[k] for k in here]),
                after=_overall([errors.after[k] for k in here]),
            )
        )
    return rows


def _overall(errors: Sequence[Array]) -> float:
    if not errors:
        return float("nan")
    return float(np.sqrt(np.mean(np.concatenate([e.ravel() for e in errors]) ** 2)))


def _plots(
    problem: Problem,
    stretches: Sequence[Problem],
    recordings: Sequence[Trajectory],
    instances: Sequence[EffectInstance],
    errors: HeldOut,
) -> tuple[EvidencePlot, ...]:
    part = problem.subset(problem.sample(PROFILED_S)).robust(instances)
    rare = reduce(Problem.joined, stretches) if stretches else part
    worst = np.argsort(-evidence.rmse(errors.before) / errors.problem.noise.position)[:2]
    return (
        *evidence.law_plots(instances, problem, recordings),
        *evidence.profile_plots(instances, part, rare),
        *(evidence.error_plot(int(j), errors.problem, errors.before, errors.after) for j in worst),
    )


def _notes(verdict: Verdict, *, outside: bool) -> tuple[str, ...]:
    notes = [
        "Errors are of open-loop rollouts whose initial state is fitted (two numbers per joint); "
        "recordings of torque commands are cut into stretches of half a second."
    ]
    if outside:
        notes.append(
            "Not everything can be written in MJCF: corrected.effects.json has the rest, and where "
            "corrected.xml is given to a gfm command it is found beside it."
        )
    if verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED):
        notes.append("What stays unexplained can be learned as a generalized force model.")
    return tuple(notes)
