"""From recordings to a verdict: the whole chain, in the order in which a reader will follow it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.quality import all_findings, doubts
from gfm.diagnosis.data.segmentation import (
    LONG,
    WHOLE,
    all_stretches,
    check_recordings,
    in_model_order,
    make_problem,
)
from gfm.diagnosis.evidence import evidence_chain
from gfm.diagnosis.evidence import plots as evidence
from gfm.diagnosis.former.attribution import Attribution
from gfm.diagnosis.former.search import search
from gfm.diagnosis.learned import learned_report
from gfm.diagnosis.objects import ObjectPart, examine_object, widened
from gfm.diagnosis.output.claims import (
    closed_share,
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
from gfm.diagnosis.residuals.problem import Problem, settled
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance
from gfm.excitation.blind_spots import blind_spots
from gfm.sim.learned import LearnedForces
from gfm.sim.passive import with_idle_drives
from gfm.sim.plant import native_spec

#: Share of the gap that has to be closed to name anything.
LEAST_SHARE = 0.05
#: Less motion or time than this says nothing about dynamics.
LEAST_MOTION_RAD, LEAST_TIME_S, LEAST_RATE_HZ = 0.01, 1.5, 10.0
#: Recorded time in which effects are looked for (of an arm; of smaller robots more).
LOOKED_AT_S = 72.0
#: Recorded time on which the profiles of amounts are drawn (of an arm; of smaller robots more).
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
    before = settled(problem, ()).position_errors(())
    if not effects:
        return HeldOut(problem=problem, before=before, after=before)
    suited = settled(with_suitable_steps(problem, effects), effects)
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
    ordered = in_model_order(specs, [*recordings, *holdout])
    driven, runs = with_idle_drives(specs, ordered)
    recordings, holdout = runs[: len(recordings)], runs[len(recordings) :]
    thing = examine_object(driven[recordings[0].command_kind], recordings, holdout, report)
    pushed = _pushed(thing)
    added = [e.instance() for e in pushed]
    beside = {kind: native_spec(_with_cone(spec, thing), added) for kind, spec in driven.items()}
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
        everything = replace(everything, stepping=problem.stepping)
        found, fitted_to = search(problem, long, everything, recordings, report)
    instances = found.fit.effects if found else ()
    report("measuring the corrected model on held-out recordings")
    errors = _errors(held, instances)
    if found and closed_share(errors.summary) < LEAST_SHARE:
        instances, errors = (), HeldOut(problem=held, before=errors.before, after=errors.before)
    models, slices = tuple(beside.values()), fitted_to.slices()
    named = (
        named_effects(slices, found, instances, errors.summary, errors.by_joint, models)
        if found
        else ()
    )
    verdict = Verdict.INSUFFICIENT_DATA if lack else verdict_on(errors.summary, named)
    both = (*named, *pushed)
    corrected = {
        kind: corrected_model(_with_cone(spec, thing), both, given, implicit=held.is_implicit(kind))
        for kind, spec in specs.items()
    }
    first = corrected[recordings[0].command_kind]
    findings = all_findings(long, recordings, holdout, instances)
    robot = Diagnosis(
        verdict=verdict,
        sentence=sentence_on(verdict, named, errors.summary, lack),
        effects=named,
        suspects=suspects_of(found, instances) if found else (),
        error=errors.summary,
        as_measured=_errors_as_measured(held, instances),
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
        plots=_plots(problem, found, recordings, instances, errors),
        notes=(
            *notes,
            *doubts(findings),
            *_notes(verdict, outside=bool(first.effects), less=any(e.takes_off for e in instances)),
            *_units(specs[recordings[0].command_kind], problem.joints),
            *_integrator(held),
        ),
        provenance=dict(provenance or {}),
    )
    return _with_object(robot, thing, pushed) if thing else robot


def _pushed(thing: ObjectPart | None) -> tuple[NamedEffect, ...]:
    """Returns what the object lacks, if that explains more than next to nothing."""
    if thing is None or closed_share(thing.overall) < LEAST_SHARE:
        return ()
    named = named_effects(thing.problem.slices(), thing.found, thing.effects, thing.overall)
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
        suspects=(*robot.suspects, *suspects_of(thing.found, thing.effects if pushed else ())),
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
    problem: Problem,
    found: Attribution | None,
    recordings: Sequence[Trajectory],
    instances: Sequence[EffectInstance],
    errors: HeldOut,
) -> tuple[EvidencePlot, ...]:
    part = problem.subset(problem.sample(PROFILED_S)).robust(instances)
    stretches, rounds = (found.stretches, found.rounds) if found else ((), ())
    rare = reduce(Problem.joined, stretches) if stretches else part
    worst = np.argsort(-evidence.rmse(errors.before) / errors.problem.noise.position)[:2]
    return (
        *evidence.law_plots(instances, problem, recordings),
        *(evidence.answers_plot(this.late_s) for this in rounds if this.late_s is not None),
        *evidence.profile_plots(instances, part, rare),
        *(evidence.error_plot(int(j), errors.problem, errors.before, errors.after) for j in worst),
    )


def _notes(verdict: Verdict, *, outside: bool, less: bool) -> tuple[str, ...]:
    notes = [
        "Errors are of open-loop rollouts whose initial state is fitted (two numbers per joint, "
        "and two per motor that rings against its link where no servo holds it); recordings of "
        "torque commands are cut into stretches of half a second, others of a robot that touches "
        "something into stretches of about two."
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
