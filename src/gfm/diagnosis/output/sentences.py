"""The answer in words."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from gfm.diagnosis.objects.examine import ObjectPart
from gfm.diagnosis.output.errors import errors_under
from gfm.diagnosis.output.result import ErrorSummary, NamedEffect, Suspect, Verdict
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.naming import grouped, placed_in_words
from gfm.effects import EffectInstance
from gfm.signals.smoothing import rms

#: Parameters of an effect that a sentence tells at most.
IN_A_SENTENCE = 3
#: What to know of a search that was ended by its time.
OUT_OF_TIME = "The time for the search was over: this is the best answer so far."


def sentence_on(
    verdict: Verdict,
    named: Sequence[NamedEffect],
    error: ErrorSummary,
    lack: str,
    suspects: Sequence[Suspect] = (),
) -> str:
    """Returns the verdict on a robot in one sentence.

    Args:
        verdict: On it.
        named: What it lacks.
        error: Before and after.
        lack: What the data do not show.
        suspects: What was considered; those that were found may have a name that is doubtful.
    """
    if verdict is Verdict.INSUFFICIENT_DATA:
        return f"The recordings do not say enough about the dynamics: {lack}."
    figures = (
        f"held-out position error {error.before:.3g} rad before, {error.after:.3g} rad after, "
        f"sensor noise {error.noise_floor:.3g} rad"
    )
    if verdict is Verdict.NO_GAP:
        return f"The model explains the recordings to within the sensor noise ({figures})."
    laws = _laws_without_name(suspects)
    if verdict is Verdict.UNEXPLAINED:
        why = _named_in_vain(named) if named else "" if laws else _without_name(suspects)
        return f"The model misses {laws or 'something'}{why} ({figures})."
    among = "" if verdict is Verdict.EXPLAINED else ", among what stays unexplained,"
    beside = f"; it also misses {laws}" if laws else ""
    return f"The model {_wrong(named, among)}{beside} ({figures})."


def _laws_without_name(suspects: Sequence[Suspect]) -> str:
    """Returns of which states of which joints laws are missing that have no name; empty if none."""
    laws = dict.fromkeys(f"a law of the {one.nameless}" for one in suspects if one.nameless)
    return f"{' and '.join(laws)} that no known effect explains" if laws else ""


def _named_in_vain(named: Sequence[NamedEffect]) -> str:
    """Returns what explains the recordings it was found in, and not those held out."""
    names = "; ".join(effects_in_words(named))
    return f", and what explains its training recordings does not explain those held out: {names}"


def _without_name(suspects: Sequence[Suspect]) -> str:
    """Returns why nothing is named: nothing explains it, or no name is likely enough."""
    doubtful = [one for one in suspects if one.confidence is not None]
    if not doubtful:
        return " that no known effect explains"
    likeliest = "; ".join(f"{placed_in_words(*one.key)} ({one.confidence:.0%})" for one in doubtful)
    return f", and no name for it is more likely right than wrong: {likeliest}"


def _wrong(named: Sequence[NamedEffect], among: str) -> str:
    """Returns what a model misses, and what it has too much of; `among` says beside what."""
    less = [one for one in named if one.instance().takes_off]
    missing = "; ".join(effects_in_words([one for one in named if one not in less]))
    much = f"too much {'; '.join(effects_in_words(less))}" if less else ""
    if not missing:
        return f"has{among} {much}"
    return f"misses{among} {missing}; it has {much}" if less else f"misses{among} {missing}"


def sentence_on_object(thing: ObjectPart) -> str:
    """Returns what a pushed object's poses say that the model lacks, in one sentence."""
    place = thing.errors[0]
    names = "; ".join(_in_words(effect) for effect in thing.named)
    lacks = f"misses {names} of the object" if names else "misses nothing with a name"
    return (
        f"By the object's poses it {lacks} (held-out error of its place {place.before:.3g} m "
        f"before, {place.after:.3g} m after, noise {place.noise_floor:.3g} m)."
    )


def effects_in_words(named: Sequence[NamedEffect]) -> list[str]:
    """Returns the effects in words, those of one kind on several joints as one."""
    return [_in_words(*alike) for alike in grouped(named, lambda one: one.effect)]


def _in_words(*alike: NamedEffect) -> str:
    """Returns effects of one kind in words, with the range of their amounts and other names."""
    first, digits = alike[0], 4 if len(alike) == 1 else 3
    amounts = []
    for name, parameter in first.parameters.items():
        values = [effect.parameters[name].value for effect in alike]
        ends = dict.fromkeys(f"{v:.{digits}g}" for v in (min(values), max(values)))
        unit = "" if parameter.unit == "1" else parameter.unit
        amounts.append(f"{name.replace('_', ' ')} {' to '.join(ends)} {unit}".rstrip())
    joints = [joint for effect in alike for joint in effect.joints]
    more = ["..."] if len(amounts) > IN_A_SENTENCE else []  # all of them stand in the table below
    shown = ", ".join([*amounts[:IN_A_SENTENCE], *more])
    told = f"{placed_in_words(first.effect, joints)} ({shown})"
    others = dict.fromkeys(other.effect for effect in alike for other in effect.equals)
    return " or ".join([told, *(name.replace("_", " ") for name in others)])


def note_on_suspects(
    held: Problem,
    named: Sequence[EffectInstance],
    every: Sequence[EffectInstance],
    error: ErrorSummary,
) -> list[str]:
    """Returns how near a model comes with suspects in it, if that is nearer than with names alone.

    Args:
        held: What errors are measured on.
        named: What corrects the model.
        every: The same and suspects.
        error: Before and after the correction.
    """
    kept = rms(errors_under(held, every)) if len(every) > len(named) else np.inf
    if kept >= error.after:
        return []
    return [f"With suspects in it (--keep-suspects) the model is {kept:.3g} rad off, held out."]


def notes_on(
    verdict: Verdict, problem: Problem, effects: Sequence[EffectInstance], *, outside: bool
) -> list[str]:
    """Returns what a reader should know of a verdict.

    Args:
        verdict: On the robot.
        problem: What errors are measured on.
        effects: What corrects the model.
        outside: Whether there is something that MJCF cannot say.
    """
    notes = [
        "Errors are of open-loop rollouts whose initial state is fitted (two numbers per joint, "
        "and two per motor that rings against its link where no servo holds it); recordings of "
        "torque commands are cut into segments of half a second."
    ]
    if any(effect.takes_off for effect in effects):
        notes.append("A negative amount takes off what the model has of it.")
    if outside:
        notes.append(
            "Not everything can be written in MJCF: corrected.effects.json has the rest, and where "
            "corrected.xml is given to a gfm command it is found beside it."
        )
    if verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED):
        notes.append("What stays unexplained can be learned as a generalized force model.")
    spec = next(iter(problem.specs.values()))
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    if sliding := [name for name in problem.joints if spec.joint(name).type == slide]:
        verb = "slides" if len(sliding) == 1 else "slide"
        notes.append(
            f"{', '.join(sliding)} {verb}: there read m for rad, N for N m, kg for kg m^2."
        )
    if any(problem.is_implicit(kind) for kind in problem.specs):
        notes.append(
            "MuJoCo's Runge-Kutta integrator does not follow the model on its time step (very "
            "stiff servos on light links do that: are rotors missing?): its `discrete` integrator "
            "is used, in the corrected model, too."
        )
    return notes
