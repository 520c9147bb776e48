"""Follows an object from look to look: what is believed, how old it is, and why not more.

A pose is told with its age and never repeated as if it were new. What no motion explains is
believed once it was seen several times in a row; until then the pose that is known grows old.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.tracking.camera import Camera
from gfm.tracking.detect import Detection
from gfm.tracking.fusion import DISAGREES, Estimate, Fused, distance, fuse
from gfm.tracking.layout import TagLayout
from gfm.tracking.motion import Agility, Motion, at, begun, corrected, expected
from gfm.tracking.rigid import Pose, apart, moved
from gfm.tracking.sighting import Candidate, candidates


@dataclass(frozen=True, kw_only=True)
class TrackerSettings:
    """What is believed.

    Attributes:
        agility: How suddenly the object may move.
        oldest_s: A pose that is older is not valid.
        skew_s: Looks that were taken so long before the newest are left out.
        sightings: How many in a row, agreeing, it takes to believe in a first pose or in a jump.
        tags: How many have to speak for a pose: nothing vouches for one alone.
        spread_m: A pose that may be further off in any direction (one standard deviation) is not
            believed.
        spread_rad: The same for its rotation.
    """

    agility: Agility = field(default_factory=Agility)
    oldest_s: float = 0.15
    skew_s: float = 0.03
    sightings: int = 3
    tags: int = 2
    spread_m: float = 0.005
    spread_rad: float = np.radians(1.0)

    def __post_init__(self) -> None:
        for name in ("oldest_s", "skew_s", "sightings", "tags", "spread_m", "spread_rad"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected more than 0")


@dataclass(frozen=True, kw_only=True)
class Look:
    """What one camera's newest image shows.

    Attributes:
        camera: Its name.
        time_s: When it was taken.
        seen: The tags in it.
    """

    camera: str
    time_s: float
    seen: Detection


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """What is known of an object.

    Attributes:
        valid: Whether the pose is young enough to be used.
        age_s: Since it was seen; infinite before the first time.
        time_s: When it was seen, None before.
        pose: The newest that was believed, None before the first.
        covariance: Of its error, shape (6, 6).
        velocity: From the two newest poses, m/s and rad/s, shape (6,), None before the second.
        smooth_velocity: The same from all of them, filtered.
        used: The cameras that it was made of.
        views: What each camera said of it alone, those included that were not believed.
        fresh: Whether it is of this look.
        refused: Cameras that were not believed this time, with why.
    """

    valid: bool
    age_s: float
    time_s: float | None
    pose: Pose | None
    covariance: Array | None
    velocity: Array | None
    smooth_velocity: Array | None
    used: tuple[str, ...]
    views: Mapping[str, Candidate]
    fresh: bool
    refused: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class _Believed:
    """A pose that was believed, and the velocity since the one before."""

    time_s: float
    fused: Fused
    velocity: Array | None


@dataclass(frozen=True, kw_only=True)
class TrackerState:
    """What a tracker remembers.

    Attributes:
        motion: How the object moves; None before it was believed in.
        believed: The newest pose.
        doubted: Another motion that would explain the newest looks, seen `times`.
        times: See there.
        last: The newest look of every camera.
        liars: Cameras that disagreed when they were last compared with others.
    """

    motion: Motion | None = None
    believed: _Believed | None = None
    doubted: Motion | None = None
    times: int = 0
    last: Mapping[str, Look] = field(default_factory=dict)
    liars: frozenset[str] = frozenset()


class Tracker:
    """Steps of following one object; remembers nothing itself.

    Args:
        cameras: All of them.
        layout: The tags on the object.
        settings: What is believed.
    """

    def __init__(
        self, cameras: Sequence[Camera], layout: TagLayout, settings: TrackerSettings | None = None
    ) -> None:
        self._cameras = {camera.name: camera for camera in cameras}
        if len(self._cameras) != len(cameras):
            raise ConfigError("two cameras have one name, expected every name once")
        self._layout = layout
        self._settings = settings or TrackerSettings()

    def step(
        self, now_s: float, looks: Sequence[Look], state: TrackerState
    ) -> tuple[Tracked, TrackerState]:
        """Returns what is known now, and what to remember.

        Args:
            now_s: On the clock of the looks; not before the last step's.
            looks: The newest of every camera; one that was given before counts as none.
            state: What was remembered.
        """
        fresh, refused = self._fresh(looks, state)
        state = replace(state, last={**state.last, **{look.camera: look for look in looks}})
        time_s = max((look.time_s for look in fresh), default=now_s)
        if state.believed is not None and time_s <= state.believed.time_s:
            return self._told(now_s, state, refused, is_fresh=False), state
        estimates = self._estimates(fresh, time_s, state.motion, refused)
        motion, agility = state.motion, self._settings.agility
        fused = fuse(estimates, None if motion is None else expected(motion, time_s, agility))
        why = self._objection(fused, estimates, state)
        if fused is None or why:
            refused.update(dict.fromkeys((e.camera for e in estimates), why))
            return self._told(now_s, state, refused, is_fresh=False), state
        refused.update(dict.fromkeys(fused.rejected, "disagrees"))
        state, is_believed = self._weighed(time_s, fused, state)
        if not is_believed:
            refused.update(dict.fromkeys(fused.used, "jumped"))
        return self._told(now_s, state, refused, is_fresh=is_believed), state

    def _fresh(
        self, looks: Sequence[Look], state: TrackerState
    ) -> tuple[list[Look], dict[str, str]]:
        """Returns the looks that are new, and why others are not.

        A camera whose image does not change stands still, whatever it stamps: noise moves the
        corners of every new image, if only in the last digits.
        """
        refused, new = {}, []
        for look in looks:
            last = state.last.get(look.camera)
            if last is not None and look.time_s <= last.time_s:
                refused[look.camera] = "nothing new"
            elif last is not None and _same(look.seen, last.seen):
                refused[look.camera] = "frozen"
            else:
                new.append(look)
        newest = max((look.time_s for look in new), default=0.0)
        late = [look for look in new if look.time_s < newest - self._settings.skew_s]
        refused.update({look.camera: "late" for look in late})
        return [look for look in new if look not in late], refused

    def _estimates(
        self, looks: Sequence[Look], time_s: float, motion: Motion | None, refused: dict[str, str]
    ) -> list[Estimate]:
        """Returns what the cameras tell, moved on to one time; adds who tells nothing."""
        estimates = []
        for look in looks:
            camera = self._cameras[look.camera]
            told = candidates(camera, self._layout, look.seen)
            if not told:
                refused[look.camera] = "no pose" if look.seen.ids else "no tag"
                continue
            late_s = time_s - look.time_s
            if late_s > 0.0:
                told = tuple(self._moved_on(one, late_s, motion) for one in told)
            estimates.append(Estimate(camera=look.camera, candidates=told))
        return estimates

    def _moved_on(self, one: Candidate, late_s: float, motion: Motion | None) -> Candidate:
        """Returns a pose some time later, by the motion that is known."""
        agility = self._settings.agility
        speed = np.repeat([agility.speed_m_s, agility.speed_rad_s], 3)
        velocity, doubt = np.zeros(6), np.diag(speed**2)
        if motion is not None:
            velocity, doubt = motion.velocity, motion.covariance[6:, 6:]
        return replace(
            one,
            pose=moved(one.pose, late_s * velocity),
            covariance=one.covariance + late_s**2 * doubt,
        )

    def _objection(
        self, fused: Fused | None, estimates: Sequence[Estimate], state: TrackerState
    ) -> str:
        """Returns why a pose is not even weighed; empty where it is."""
        if fused is None:
            return "ambiguous" if estimates else ""
        if state.liars.issuperset(fused.used):
            return "disagreed before"
        if fused.tags < self._settings.tags:
            return "one tag"
        largest = [
            np.sqrt(np.linalg.eigvalsh(fused.covariance[part, part])[-1])
            for part in (slice(3), slice(3, 6))
        ]
        settings = self._settings
        if largest[0] > settings.spread_m or largest[1] > settings.spread_rad:
            return "uncertain"
        return ""

    def _weighed(
        self, time_s: float, fused: Fused, state: TrackerState
    ) -> tuple[TrackerState, bool]:
        """Returns what to remember of a pose, and whether it is believed."""
        agility = self._settings.agility
        if (followed := _continued(state.motion, time_s, fused, agility)) is not None:
            return self._believing(time_s, fused, followed, state), True
        times, doubted = 1, _continued(state.doubted, time_s, fused, agility)
        if doubted is None:
            doubted = begun(time_s, fused, agility)
        else:
            times = state.times + 1
        if times >= self._settings.sightings:
            jumped = replace(state, believed=None)
            return self._believing(time_s, fused, doubted, jumped), True
        return replace(state, doubted=doubted, times=times), False

    def _believing(
        self, time_s: float, fused: Fused, motion: Motion, state: TrackerState
    ) -> TrackerState:
        before = state.believed
        velocity = None
        if before is not None:
            velocity = apart(fused.pose, before.fused.pose) / (time_s - before.time_s)
        liars = state.liars
        if len(fused.used) > 1 or fused.was_expected:
            liars = (liars - set(fused.used)) | set(fused.rejected)
        return TrackerState(
            motion=motion,
            believed=_Believed(time_s=time_s, fused=fused, velocity=velocity),
            last=state.last,
            liars=liars,
        )

    def _told(
        self, now_s: float, state: TrackerState, refused: Mapping[str, str], *, is_fresh: bool
    ) -> Tracked:
        known, motion = state.believed, state.motion
        age_s = np.inf if known is None else now_s - known.time_s
        return Tracked(
            valid=age_s <= self._settings.oldest_s,
            age_s=age_s,
            time_s=None if known is None else known.time_s,
            pose=None if known is None else known.fused.pose,
            covariance=None if known is None else known.fused.covariance,
            velocity=None if known is None else known.velocity,
            smooth_velocity=None if known is None or motion is None else motion.velocity,
            used=() if known is None else known.fused.used,
            views={} if known is None else known.fused.views,
            fresh=is_fresh,
            refused=refused,
        )


def _continued(
    motion: Motion | None, time_s: float, fused: Fused, agility: Agility
) -> Motion | None:
    """Returns a motion after a pose that it explains; None where there is none, or it does not."""
    if motion is None or motion.time_s >= time_s:
        return None
    if distance(fused, expected(motion, time_s, agility)) >= DISAGREES:
        return None
    return corrected(at(motion, time_s, agility), fused)


def _same(one: Detection, other: Detection) -> bool:
    return bool(one.ids) and one.ids == other.ids and np.array_equal(one.corners, other.corners)
