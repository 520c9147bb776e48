"""From recordings to a verdict: the whole chain, in the order in which a reader will follow it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import islice

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.changes import Found, what_changed
from gfm.diagnosis.data.quality import all_findings, doubts
from gfm.diagnosis.data.segmentation import (
    LONG,
    SHORT,
    WHOLE,
    all_segments,
    check_recordings,
    in_model_order,
    make_problem,
)
from gfm.diagnosis.evidence import evidence_chain, plots
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.learned import learned_report
from gfm.diagnosis.objects import ObjectPart, examine_object, widened
from gfm.diagnosis.output.changes import Changes
from gfm.diagnosis.output.claims import (
    credible,
    named_effects,
    suspects_of,
    verdict_on,
    verdict_on_both,
)
from gfm.diagnosis.output.correction import corrected_model
from gfm.diagnosis.output.result import (
    Diagnosis,
    ErrorSummary,
    EvidencePlot,
    JointError,
    NamedEffect,
    RecordingSummary,
    Verdict,
)
from gfm.diagnosis.output.sentences import sentence_on, sentence_on_object
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.diagnosis.search.loop import search
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance
from gfm.excitation.blind_spots import blind_spots
from gfm.sim.learned import LearnedForces
from gfm.sim.passive import with_idle_drives
from gfm.sim.plant import native_spec

#: Less motion or time than this says nothing about dynamics.
LEAST_MOTION_RAD, LEAST_TIME_S, LEAST_RATE_HZ = 0.01, 1.5, 10.0
#: Recorded time in which effects are looked for, and on which amounts are settled, s.
SEARCHED_S, SETTLED_S = 24.0, 36.0
#: Recorded time on which the profiles of amounts are drawn, s.
PROFILED_S = 12.0


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Held-out errors of the nominal and the corrected model, per segment (T, J), rad."""

    problem: Problem
    before: list[Array]
    after: list[Array]

    @property
    def by_joint(self) -> dict[str, ErrorSummary]:
        """Returns the same three numbers of every joint."""
        both = plots.rmse(self.before), plots.rmse(self.after)
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
    before = problem.settled(()).position_errors(())
    if not effects:
        return HeldOut(problem=problem, before=before, after=before)
    suited = with_suitable_steps(problem, effects).settled(effects)
    return HeldOut(problem=problem, before=before, after=suited.position_errors(effects))


def _errors_as_measured(problem: Problem, effects: Sequence[EffectInstance]) -> ErrorSummary:
    """Returns the errors of both models begun as measured: nothing of them is fitted away."""
    before = problem.as_measured().position_errors(())
    after = before
    if effects:
        suited = with_suitable_steps(problem, effects)
        after = suited.as_measured().position_errors(effects)
    return HeldOut(problem=problem, before=before, after=after).summary


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
    time_left: Callable[[], float] = lambda: 1.0,
    keep_suspects: bool = False,
    since: Sequence[Sequence[Trajectory]] = (),
) -> Diagnosis:
    """Returns what `specs` lack to explain `recordings`, judged on `holdout`.

    Args:
        specs: The nominal model by the kind of command that its actuators take.
        recordings: What effects are looked for in and fitted to.
        holdout: What errors are measured on; nothing that names an effect reads them.
        report: Told what is happening, in words.
        provenance: What the result should say about where it came from.
        notes: Remarks of the caller that a reader should see.
        given: Effects of the nominal model that `specs` cannot say.
        learned: Forces that were fitted to recordings under the nominal model, to be named, too.
        time_left: The share of the time for searching that is left.
        keep_suspects: Whether effects that are more likely wrong than right stay in the model.
        since: Earlier sets of recordings, oldest first, since which changes are told.

    Raises:
        BadInputError: recordings, models and forces do not belong together.
    """
    every = [*recordings, *holdout, *(one for earlier in since for one in earlier)]
    check_recordings(specs, every)
    driven, runs = with_idle_drives(specs, in_model_order(specs, every))
    rest = iter(runs)
    recordings, holdout, *since = (
        list(islice(rest, len(part))) for part in (recordings, holdout, *since)
    )
    thing = examine_object(driven[recordings[0].command_kind], recordings, holdout, report)
    pushed = _pushed(thing)
    added = [e.instance() for e in pushed]
    case = _Case(
        specs=specs,
        beside={kind: native_spec(_with_cone(s, thing), added) for kind, s in driven.items()},
        recordings=recordings,
        holdout=holdout,
        given=tuple(given),
        lack=_lacking(recordings),
    )
    found = _found(case, report, time_left)
    named = found.named(keep_suspects=keep_suspects)
    report("measuring the corrected model on held-out recordings")
    robot = _judged(case, found, named, [*named, *pushed], thing)
    told = learned_report(found.long, recordings, learned) if learned else None
    robot = replace(
        robot,
        gfm=told,
        changes=_changes(case, found, since, report, time_left) if since else None,
        notes=(*notes, *_out_of_time(found), *robot.notes),
        provenance=dict(provenance or {}),
    )
    return _with_object(robot, thing, pushed) if thing else robot


@dataclass(frozen=True, kw_only=True)
class _Case:
    """What a diagnosis is about.

    Attributes:
        specs: As given.
        beside: The same with what the object lacks.
        recordings: To learn from.
        holdout: To judge on.
        given: Effects of the nominal model that `specs` cannot say.
        lack: Why nothing can be said about dynamics, or an empty text.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    beside: Mapping[CommandKind, mujoco.MjSpec]
    recordings: Sequence[Trajectory]
    holdout: Sequence[Trajectory]
    given: tuple[EffectInstance, ...]
    lack: str


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What was found in the training recordings, and the problems that tell of it."""

    short: Problem
    long: Problem
    result: SearchResult | None

    def named(self, *, keep_suspects: bool) -> tuple[NamedEffect, ...]:
        """Returns the effects that are named, with amounts fitted without the others."""
        if self.result is None:
            return ()
        result = self.result
        effects = list(result.fit.effects) if keep_suspects else credible(result)
        if len(effects) < len(result.fit.effects):
            result = replace(result, fit=fit(self.long, effects))
        return named_effects(self.long.slices(), result, result.fit.effects)


def _found(case: _Case, report: Callable[[str], None], time_left: Callable[[], float]) -> _Found:
    """Returns what is found in the training recordings."""
    report("measuring the nominal model")
    specs, recordings = case.beside, case.recordings
    short = make_problem(specs, recordings, given=case.given, most_s=SEARCHED_S)
    long = short
    if any(LONG[kind] > SHORT[kind] for kind in specs):
        long = make_problem(
            specs, recordings, short.noise, given=case.given, windows_s=LONG, most_s=SETTLED_S
        )
    if case.lack:
        return _Found(short=short, long=long, result=None)
    everything = all_segments(specs, recordings, short.noise, given=case.given)
    result, long = search(short, long, everything, recordings, report, time_left)
    return _Found(short=short, long=long, result=result)


def _changes(
    case: _Case,
    now: _Found,
    since: Sequence[Sequence[Trajectory]],
    report: Callable[[str], None],
    time_left: Callable[[], float],
) -> Changes | None:
    """Returns what changed since earlier sets of recordings; None where nothing can be said now."""
    sets = [_as_set(now, case.recordings)]
    if sets[0] is None:
        return None
    for earlier in reversed(since):
        report(f"looking at an earlier set: {', '.join(one.name for one in earlier)}")
        before = replace(case, recordings=earlier, lack=_lacking(earlier))
        if before.lack:
            raise ConfigError(f"{earlier[0].name}: {before.lack}; expected motion to compare with")
        sets.append(_as_set(_found(before, report, time_left), earlier))
    found = [one for one in reversed(sets) if one is not None]
    return what_changed(found, case.beside.values(), case.given, report)


def _as_set(found: _Found, recordings: Sequence[Trajectory]) -> Found | None:
    if found.result is None:
        return None
    return Found(
        names=tuple(one.name for one in recordings),
        problem=found.long,
        effects=found.result.fit.effects,
        credible=credible(found.result),
    )


def _judged(
    case: _Case,
    found: _Found,
    named: tuple[NamedEffect, ...],
    both: Sequence[NamedEffect],
    thing: ObjectPart | None,
) -> Diagnosis:
    """Returns the diagnosis of the robot: named effects judged on held-out recordings."""
    held = make_problem(
        case.beside, case.holdout, found.short.noise, given=case.given, windows_s=WHOLE
    )
    instances = tuple(one.instance() for one in named)
    errors = _errors(held, instances)
    verdict = Verdict.INSUFFICIENT_DATA if case.lack else verdict_on(errors.summary, named)
    corrected = {
        kind: corrected_model(
            _with_cone(spec, thing), both, case.given, implicit=held.is_implicit(kind)
        )
        for kind, spec in case.specs.items()
    }
    first = corrected[case.recordings[0].command_kind]
    findings = all_findings(found.long, case.recordings, case.holdout, instances)
    result = found.result
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_on(verdict, named, errors.summary, case.lack),
        effects=named,
        suspects=suspects_of(result, instances) if result else (),
        error=errors.summary,
        as_measured=_errors_as_measured(held, instances),
        joints=_joint_errors(errors),
        recordings=tuple(
            replace(row, warnings=doubts(findings, row.name))
            for row in _inputs(found.short, case.recordings, errors, case.holdout, instances)
        ),
        findings=findings,
        blind_spots=blind_spots(case.recordings),
        corrected_xml=first.xml,
        corrected_effects=first.effects,
        twins=corrected if len(corrected) > 1 else {},
        chain=evidence_chain(held, case.holdout, result, instances, (errors.before, errors.after)),
        plots=_plots(found, case.recordings, instances, errors),
        notes=(
            *doubts(findings),
            *_notes(verdict, outside=bool(first.effects), less=any(e.takes_off for e in instances)),
            *_units(case.specs[case.recordings[0].command_kind], found.long.joints),
            *_integrator(held),
        ),
    )


def _out_of_time(found: _Found) -> tuple[str, ...]:
    """Returns what to know of a search that was ended by its time."""
    if found.result is None or not found.result.out_of_time:
        return ()
    return ("The time for the search was over: this is the best answer so far.",)


def _pushed(thing: ObjectPart | None) -> tuple[NamedEffect, ...]:
    """Returns what the object lacks, if it is more likely right than not."""
    if thing is None:
        return ()
    named = named_effects(thing.problem.slices(), thing.found, credible(thing.found))
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
    felt = {effect.effect for effect in robot.effects}  # by what it took to push it
    return replace(
        robot,
        verdict=verdict_on_both(robot.verdict, verdict_on(thing.overall, pushed)),
        sentence=f"{robot.sentence} {sentence_on_object(thing, pushed)}",
        effects=(*robot.effects, *pushed),
        suspects=(*robot.suspects, *suspects_of(thing.found, [e.instance() for e in pushed])),
        object_error=dict(zip(("position", "yaw"), thing.errors, strict=True)),
        blind_spots=(
            *robot.blind_spots,
            *(spot for spot in thing.blind_spots if spot.effect not in felt),
        ),
        plots=(*robot.plots, *thing.plots),
        notes=(*robot.notes, *thing.notes),
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
    found: _Found,
    recordings: Sequence[Trajectory],
    instances: Sequence[EffectInstance],
    errors: HeldOut,
) -> tuple[EvidencePlot, ...]:
    part = found.short.subset(found.short.sample(PROFILED_S)).robust(instances)
    segments = found.result.segments if found.result else ()
    rare = reduce(Problem.joined, segments) if segments else part
    worst = np.argsort(-plots.rmse(errors.before) / errors.problem.noise.position)[:2]
    return (
        *plots.law_plots(instances, found.short, recordings),
        *plots.profile_plots(instances, part, rare),
        *(plots.error_plot(int(j), errors.problem, errors.before, errors.after) for j in worst),
    )


def _notes(verdict: Verdict, *, outside: bool, less: bool) -> tuple[str, ...]:
    notes = [
        "Errors are of open-loop rollouts whose initial state is fitted (two numbers per joint, "
        "and two per motor that rings against its link where no servo holds it); recordings of "
        "torque commands are cut into segments of half a second, others of a robot that touches "
        "something into segments of about two."
    ]
    if less:
        notes.append("A negative amount takes off what the model has of it.")
    if outside:
        notes.append(
            "Not everything can be written in MJCF: corrected.effects.json has the rest, and where "
            "corrected.xml is given to a gfm command it is found beside it."
        )
    if verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED):
        notes.append("What stays unexplained can be learned as a generalized force model.")
    return tuple(notes)


def _integrator(problem: Problem) -> tuple[str, ...]:
    """Returns what to know of a model that the usual integrator does not follow on its step."""
    if not any(problem.is_implicit(kind) for kind in problem.specs):
        return ()
    return (
        "MuJoCo's Runge-Kutta integrator does not follow the model on its time step (very stiff "
        "servos on light links do that: are rotors missing?): its `discrete` integrator is used, "
        "in the corrected model, too.",
    )


def _units(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[str, ...]:
    """Returns what to read for the units of joints that slide."""
    sliding = [name for name in joints if spec.joint(name).type == mujoco.mjtJoint.mjJNT_SLIDE]
    if not sliding:
        return ()
    verb = "slides" if len(sliding) == 1 else "slide"
    return (f"{', '.join(sliding)} {verb}: there read m for rad, N for N m, kg for kg m^2.",)
