"""The object's part of a diagnosis: what it lacks in the model, and how sure that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core import ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.objects.find import Here, find, friction_cost, seen_and_unseen, settled_with
from gfm.diagnosis.objects.problem import ObjectProblem, predicted
from gfm.diagnosis.output.claims import credible, named_effects
from gfm.diagnosis.output.errors import error_summary
from gfm.diagnosis.output.result import ErrorSummary, EvidencePlot, NamedEffect, Series
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance
from gfm.effects.objects import free_body
from gfm.excitation.blind_spots import BlindSpot
from gfm.signals.object_segments import Scene, cut, depth_m, moved
from gfm.signals.object_track import plane_noise, track_of
from gfm.sim.object_stage import make_stage, run

#: Segments that are looked at, at most: those in which the object moves farthest.
MOST_SEGMENTS = 24
#: How far amounts are off although all fits: contacts of MuJoCo slide 1 % farther or less far than
#: friction says. As a share of the amount, and of the coefficient of friction by so much.
CONTACT_SHARE, CONTACT_FRICTION = 0.05, 0.005
#: Why poses alone do not tell something.
UNSEEN = {
    "object_mass": "with the robot's motion given, no recorded pose depends on it",
    "object_com": "the object hardly turns where it moves",
    "object_damping": "the object is not let go while it moves",
    "object_friction": "the object does not slide by itself, and pushes do not tell it",
}
#: Said where nothing is said of the object.
NOTE_ON_DEPTH = (
    "Where the robot pushes the object it is {mm:.0f} mm inside it, by what was measured: one of "
    "them is elsewhere than the model has it, or has another shape (an offset of an encoder or of "
    "a camera, another tool, another object). So nothing is said of it."
)


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """How contacts are computed.

    Attributes:
        cone: Of friction, a `mujoco.mjtCone`: pyramidal ones hold less along their diagonals.
        time: Their time constants, as shares of the model's: soft ones give way, and throw back.
    """

    cone: int
    time: float = 1.0

    def applied(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Returns a model with such contacts."""
        changed = spec.copy()
        changed.option.cone = self.cone
        for one in (*changed.geoms, *changed.pairs):
            if one.solref[0] > 0.0:  # what is below says stiffness and damping instead
                one.solref[0] *= self.time
        return changed

    def times(self, share: float) -> Contacts:
        """Returns such contacts with other time constants."""
        return replace(self, time=share * self.time)


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectPart:
    """What is known of the object.

    Attributes:
        found: The search.
        overall: Held-out error of place and yaw together, in units of their noise.
        errors: Held-out errors of the place (m) and the yaw (rad).
        contacts: How they are computed: as the model says, or otherwise where that predicts better.
        plots: The object's path.
        blind_spots: What the recordings could not have shown.
        unseen: Effects that the poses do not show, by name; none where nothing is said of it.
        notes: What a reader should know.
    """

    found: SearchResult[ObjectProblem]
    overall: ErrorSummary
    errors: tuple[ErrorSummary, ErrorSummary]
    contacts: Contacts
    plots: tuple[EvidencePlot, ...]
    blind_spots: tuple[BlindSpot, ...]
    unseen: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def named(self) -> tuple[NamedEffect, ...]:
        """What of it is more likely right than not."""
        return tuple(map(_widened, named_effects(self.found, credible(self.found))))


def examine_object(
    spec: mujoco.MjSpec,
    recordings: Sequence[Trajectory],
    holdout: Sequence[Trajectory],
    report: Callable[[str], None],
    time_left: Callable[[], float] = lambda: 1.0,
) -> ObjectPart | None:
    """Returns what the object lacks in a model; None where none is recorded, or none moves.

    Args:
        spec: The model, with what it lacks of the robot.
        recordings: To learn from.
        holdout: To judge by.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left; contacts are asked within it.

    Raises:
        ConfigError: poses were recorded and the model has no free body, or several.
    """
    seen_in = [one.name for one in (*recordings, *holdout) if one.object_track is not None]
    if not seen_in:
        return None
    if free_body(spec) is None:
        raise ConfigError(
            f"{seen_in[0]}: has poses of an object; the model has no body with a free joint, "
            "expected one for it"
        )
    report("looking at the object")
    scenes = _scenes(spec, recordings)
    training = _problem(spec, scenes)
    if training is None:
        return None
    held, depth = _problem(spec, _scenes(spec, holdout)), depth_m(scenes)
    elsewhere = depth > scenes[0].within_m
    own = Contacts(cone=int(spec.option.cone))
    contacts = own if elsewhere else _with_better_cone(training, own)
    best = replace(training, spec=contacts.applied(spec))
    seen, unseen = seen_and_unseen(best)
    found = find(best, () if elsewhere else seen, report)
    if not elsewhere and time_left() > 0.0:
        report("looking at contacts")
        harder = _as_hard(training, contacts, found)
        if harder != contacts:
            contacts, best = harder, replace(training, spec=harder.applied(spec))
            found = find(best, seen, report)
    judged, effects = held or training, found.fit.effects
    before, after = judged.settled(()), replace(judged, spec=best.spec).settled(effects)
    overall, place, yaw = _errors(before.parts(()), after.parts(effects), judged.noise)
    return ObjectPart(
        found=found,
        overall=overall,
        errors=(place, yaw),
        contacts=contacts,
        plots=(_path_plot(before, after, effects),),
        blind_spots=tuple(
            BlindSpot(effect=e.name, joints=(), why=UNSEEN[e.name], motion=e.shown_by)
            for e in unseen
        ),
        unseen=() if elsewhere else tuple(e.name for e in unseen),
        notes=(
            *((NOTE_ON_DEPTH.format(mm=1e3 * depth),) if elsewhere else ()),
            *_notes(found.problem, own, contacts, held=held is not None),
        ),
    )


def _with_better_cone(problem: ObjectProblem, own: Contacts) -> Contacts:
    """Returns those contacts with which friction explains more: the model's, or elliptic ones."""
    elliptic = replace(own, cone=int(mujoco.mjtCone.mjCONE_ELLIPTIC))
    if elliptic == own:
        return own
    return min(
        (own, elliptic),
        key=lambda one: friction_cost(replace(problem, spec=one.applied(problem.spec))),
    )


def _as_hard(
    problem: ObjectProblem, contacts: Contacts, found: SearchResult[ObjectProblem]
) -> Contacts:
    """Returns contacts as hard as it predicts clearly better with what was found, if it does.

    What they err would pass for an effect; and what an effect does, for contacts. So they are asked
    after it, beside it.
    """

    def there(one: Contacts) -> Here:
        return settled_with(replace(problem, spec=one.applied(problem.spec)), found.fit.effects)

    here, best = there(contacts), contacts
    for share in (0.5, 2.0):
        while (other := there(best.times(share))).over(here.fit).clear:
            here, best = other, best.times(share)
        if best != contacts:
            break
    return best


def _widened(named: NamedEffect) -> NamedEffect:
    """Returns an effect whose intervals allow for the inexactness of contacts."""
    least = CONTACT_FRICTION if named.effect == "object_friction" else 0.0
    parameters = {}
    for name, one in named.parameters.items():
        interval = one.ci95
        if interval is not None:
            half = 0.5 * (interval[1] - interval[0])
            half = float(np.linalg.norm([half, CONTACT_SHARE * one.value, least]))
            interval = (one.value - half, one.value + half)
        parameters[name] = replace(one, ci95=interval)
    return replace(named, parameters=parameters)


def _scenes(spec: mujoco.MjSpec, recordings: Sequence[Trajectory]) -> list[Scene]:
    """Returns those recordings that have poses of the object, ready to be cut."""
    known = {i: track for i, one in enumerate(recordings) if (track := track_of(one)) is not None}
    if not known:
        return []
    noise = plane_noise([*known.values()])
    stage, air = make_stage(spec), make_stage(spec, robot_touches=False)
    return [
        Scene(index=i, recording=recordings[i], track=track, stage=stage, air=air, noise=noise)
        for i, track in known.items()
    ]


def _problem(spec: mujoco.MjSpec, scenes: Sequence[Scene]) -> ObjectProblem | None:
    """Returns the segments of recordings as a problem; None where the object never moves."""
    every = [segment for scene in scenes for segment in cut(scene)]
    if not every:
        return None
    noise = scenes[0].noise
    # A fit of how a push goes on from its midst hides what differs, and is far off where it errs.
    segments = [one for one in every if one.place_error is not None or not one.pushed] or every
    farthest = sorted(segments, key=lambda one: -moved(one.plane, noise))[:MOST_SEGMENTS]
    kept = tuple(one for one in segments if one in farthest)
    return ObjectProblem(spec=spec, segments=kept, noise=noise)


def _errors(
    before: Sequence[Array], after: Sequence[Array], noise: Array
) -> tuple[ErrorSummary, ...]:
    """Returns the errors of all together in units of the noise, of the place, and of the yaw.

    Given is what models leave in units of the noise, by segment, shape (3 P,) each, and the noise
    of x, y (m) and yaw (rad), shape (3,).
    """
    left, rest = (np.concatenate(parts).reshape(-1, 3) for parts in (before, after))
    told = ((slice(3), np.ones(3), "noise"), (slice(2), noise[:2], "m"), (2, noise[2:], "rad"))
    return tuple(
        error_summary([size * left[:, columns]], [size * rest[:, columns]], size, unit)
        for columns, size, unit in told
    )


def _notes(
    problem: ObjectProblem, own: Contacts, contacts: Contacts, *, held: bool
) -> tuple[str, ...]:
    pushed = sum(segment.pushed for segment in problem.segments)
    notes = [
        f"The object was followed through {len(problem.segments)} short segments in which it "
        f"moves ({pushed} pushed, {len(problem.segments) - pushed} by itself), the robot moving "
        "as measured; how each begins is fitted."
    ]
    if not held:
        notes.append("The object moves in no held-out recording: its errors are those of the fit.")
    if contacts.cone != own.cone:
        notes.append(
            "Friction of the object is the same in all directions: contacts are elliptic in "
            "corrected.xml; the pyramidal ones of the model slide farther along their diagonals."
        )
    if contacts.time != own.time:
        kind = "harder" if contacts.time < own.time else "softer"
        notes.append(
            f"The object moves as where contacts are {kind}: in corrected.xml their time constants "
            f"(solref) are {contacts.time:g} times those of the model."
        )
    return tuple(notes)


def _path_plot(
    before: ObjectProblem, after: ObjectProblem, effects: Sequence[EffectInstance]
) -> EvidencePlot:
    """Returns the object's measured and predicted path in the longest segment."""
    lengths = [float(np.ptp(s.plane[:, :2], axis=0).max()) for s in before.segments]
    longest = int(np.argmax(lengths))
    shown = {
        "measured": before.segments[longest].plane,
        "nominal model": _path(before, longest, ()),
        **({"corrected model": _path(after, longest, effects)} if effects else {}),
    }
    return EvidencePlot(
        title="Path of the object in the longest segment",
        effect=effects[0].effect.name if effects else "",
        joint="object",
        x_label="x [m]",
        y_label="y [m]",
        series=tuple(
            Series(label=label, x=x, y=y, style="points" if label == "measured" else "line")
            for label, (x, y, _) in ((label, path.T) for label, path in shown.items())
        ),
    )


def _path(problem: ObjectProblem, index: int, effects: Sequence[EffectInstance]) -> Array:
    """Returns the predicted path in one segment, shape (P, 3)."""
    stage, segment = make_stage(problem.spec, effects), problem.segments[index]
    return predicted(segment, run(stage, [segment.setting])[0], stage.timestep_s)
