"""From recordings to a verdict: the whole chain, in the order in which a reader will follow it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import chain, islice

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.diagnosis.changes import what_changed
from gfm.diagnosis.data.findings import all_findings
from gfm.diagnosis.data.segmentation import (
    WHOLE,
    all_segments,
    check_recordings,
    in_model_order,
    prepared,
)
from gfm.diagnosis.evidence import plots
from gfm.diagnosis.evidence.links import evidence_chain
from gfm.diagnosis.found import Found, find_by_itself, with_felt
from gfm.diagnosis.learned import learned_report
from gfm.diagnosis.objects.examine import ObjectPart, examine_object
from gfm.diagnosis.output.changes import Changes
from gfm.diagnosis.output.claims import credible, suspects_of, verdict_on, verdict_on_both
from gfm.diagnosis.output.correction import corrected_model
from gfm.diagnosis.output.errors import RolloutErrors, rollout_errors
from gfm.diagnosis.output.result import Diagnosis, EvidencePlot, ModelPair, NamedEffect, Verdict
from gfm.diagnosis.output.sentences import (
    OUT_OF_TIME,
    note_on_suspects,
    notes_on,
    sentence_on,
    sentence_on_object,
)
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.trace import parts_of
from gfm.effects import EffectInstance, Scope
from gfm.excitation.blind_spots import blind_spots
from gfm.signals.examine import doubts
from gfm.sim.learned import LearnedForces
from gfm.sim.passive import with_idle_drives
from gfm.sim.plant import native_spec

#: Recorded time on which the profiles of amounts are drawn, s.
PROFILED_S = 12.0

Specs = Mapping[CommandKind, mujoco.MjSpec]


def diagnose(
    specs: Specs,
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
    driven, (recordings, holdout, *since) = _made_ready(specs, [recordings, holdout, *since])
    look_in = partial(find_by_itself, specs=driven, given=given, report=report, time_left=time_left)
    found = look_in(recordings)
    # Where the tool is follows from the joints: an encoder's offset would be told as the object's.
    lacks = [] if found.result is None else credible(found.result)
    spec = native_spec(driven[recordings[0].command_kind], lacks)
    thing = examine_object(spec, recordings, holdout, report, time_left)
    beside = _with_object(driven, thing)
    unseen = () if thing is None else thing.unseen
    found = with_felt(found, beside, unseen, report, time_left)
    named = found.named(keep_suspects=keep_suspects)
    report("measuring the corrected model on held-out recordings")
    robot = _judged(specs, beside, found, holdout, named, thing)
    robot = replace(
        robot,
        gfm=learned_report(found.long, recordings, learned) if learned else None,
        changes=_changes(
            found, since, lambda s: with_felt(look_in(s), beside, unseen, report, time_left), report
        ),
        notes=(*notes, *robot.notes),
        provenance=dict(provenance or {}),
    )
    return robot if thing is None else _on_both(robot, thing)


def _made_ready(
    specs: Specs, sets: Sequence[Sequence[Trajectory]]
) -> tuple[Specs, list[list[Trajectory]]]:
    """Returns models with a drive for every joint, and recordings with joints in their order."""
    every = [one for part in sets for one in part]
    check_recordings(specs, every)
    driven, runs = with_idle_drives(specs, in_model_order(specs, every))
    rest = iter(runs)
    return driven, [list(islice(rest, len(part))) for part in sets]


def _with_object(specs: Specs, thing: ObjectPart | None) -> Specs:
    """Returns the models with what they lack of the object."""
    if thing is None:
        return specs
    lacks = [one.instance() for one in thing.named]
    return {kind: native_spec(thing.contacts.applied(s), lacks) for kind, s in specs.items()}


def _judged(
    specs: Specs,
    beside: Specs,
    found: Found,
    holdout: Sequence[Trajectory],
    named: tuple[NamedEffect, ...],
    thing: ObjectPart | None,
) -> Diagnosis:
    """Returns the diagnosis of the robot: named effects judged on held-out recordings.

    `beside` are the models with what they lack of the object.
    """
    given, result, effects = found.long.given, found.result, tuple(e.instance() for e in named)
    held = prepared(
        all_segments(
            beside, holdout, found.short.noise, given=given, windows_s=WHOLE, placed=effects
        )
    )
    errors = rollout_errors(held, effects)
    verdict = Verdict.INSUFFICIENT_DATA if found.lack else verdict_on(errors.summary, named)
    corrected = _corrected(specs, held, named, thing)
    first = corrected[found.recordings[0].command_kind]
    suspects = tuple(chain.from_iterable(suspects_of(one, effects) for one in found.results))
    findings = all_findings(found.long, found.recordings, holdout, effects)
    rows = (
        *rollout_errors(found.short, effects).of_each(found.recordings, "training"),
        *errors.of_each(holdout, "held-out"),
    )
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_on(verdict, named, errors.summary, found.lack, suspects),
        effects=named,
        suspects=suspects,
        error=errors.summary,
        as_measured=rollout_errors(held, effects, as_measured=True).summary,
        joints=errors.joints,
        recordings=tuple(replace(row, warnings=doubts(findings, row.name)) for row in rows),
        findings=findings,
        blind_spots=blind_spots(found.recordings),
        corrected_xml=first.xml,
        corrected_effects=first.effects,
        twins=corrected if len(corrected) > 1 else {},
        chain=evidence_chain(held, holdout, result, effects, (errors.before, errors.after)),
        plots=_plots(found, effects, errors),
        motion=errors.worst(holdout),
        notes=(
            *((OUT_OF_TIME,) if result and result.out_of_time else ()),
            *doubts(findings),
            *note_on_suspects(held, effects, found.every, errors.summary),
            *notes_on(verdict, held, effects, outside=bool(first.effects)),
            *_note_on_touching(beside, holdout, held, effects),
        ),
    )


def _corrected(
    specs: Specs, held: Problem, named: Sequence[NamedEffect], thing: ObjectPart | None
) -> dict[CommandKind, ModelPair]:
    """Returns the corrected models by the kind of command."""
    if thing is not None:
        specs = {kind: thing.contacts.applied(spec) for kind, spec in specs.items()}
        named = [*named, *thing.named]
    return {
        kind: corrected_model(spec, named, held.given, implicit=held.is_implicit(kind))
        for kind, spec in specs.items()
    }


def _note_on_touching(
    specs: Specs, holdout: Sequence[Trajectory], held: Problem, effects: Sequence[EffectInstance]
) -> list[str]:
    """Returns what to know of errors where the robot touches something, if it does."""
    touching = all_segments(
        specs, holdout, held.noise, given=held.given, placed=effects, touching=True
    )
    if not touching.segments:
        return []
    errors = rollout_errors(prepared(touching), effects).summary
    return [
        "Errors are those of the robot in the air. In held-out segments in which it touches "
        f"something, contacts simulated, they are {errors.before:.3g} rad before and "
        f"{errors.after:.3g} rad after."
    ]


def _plots(
    found: Found, effects: Sequence[EffectInstance], errors: RolloutErrors
) -> tuple[EvidencePlot, ...]:
    part = found.short.subset(found.short.sample(PROFILED_S)).robust(effects)
    segments = parts_of(found.result.steps).values() if found.result else ()
    felt = [one for one in effects if one.effect.scope is Scope.OBJECT]
    robot = [one for one in effects if one not in felt]
    rare = reduce(Problem.joined, segments) if segments else None
    floors = [-one.before / one.noise_floor for one in errors.joints.values()]
    worst = np.argsort(floors)[:2].tolist()
    return (
        *plots.law_plots(robot, found.short, found.recordings),
        *plots.profile_plots(robot, part, rare),
        *(plot for one in found.results[1:] for plot in plots.profile_plots(felt, one.problem)),
        *(plots.error_plot(j, errors.problem, errors.before, errors.after) for j in worst),
    )


def _changes(
    now: Found,
    since: Sequence[Sequence[Trajectory]],
    look_in: Callable[[Sequence[Trajectory]], Found],
    report: Callable[[str], None],
) -> Changes | None:
    """Returns what changed since earlier sets of recordings; None where nothing can be said now."""
    if now.result is None or not since:
        return None
    sets = [now]
    for earlier in reversed(since):
        report(f"looking at an earlier set: {', '.join(one.name for one in earlier)}")
        before = look_in(earlier)
        if before.lack:
            raise ConfigError(f"{earlier[0].name}: {before.lack}; expected motion to compare with")
        sets.insert(0, before)
    return what_changed(sets, report)


def _on_both(robot: Diagnosis, thing: ObjectPart) -> Diagnosis:
    """Returns the answer on robot and object together."""
    felt = {effect.effect for effect in robot.effects}  # by what it took to push it
    unseen = [spot for spot in thing.blind_spots if spot.effect not in felt]
    pushed = [one.instance() for one in thing.named]
    return replace(
        robot,
        verdict=verdict_on_both(robot.verdict, verdict_on(thing.overall, thing.named)),
        sentence=f"{robot.sentence} {sentence_on_object(thing)}",
        effects=(*robot.effects, *thing.named),
        suspects=(*robot.suspects, *suspects_of(thing.found, pushed)),
        object_error=dict(zip(("position", "yaw"), thing.errors, strict=True)),
        blind_spots=(*robot.blind_spots, *unseen),
        plots=(*robot.plots, *thing.plots),
        notes=(*robot.notes, *thing.notes),
    )
