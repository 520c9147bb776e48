"""`gfm track run`: looks at cameras, and tells, records and sends what is known of the object."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gfm.core import BadInputError, Clock, MonotonicClock
from gfm.experiments.track_send import PoseSender
from gfm.launch.address import RunAddress
from gfm.recording.new_file import check_free
from gfm.recording.writer import RecordingWriter
from gfm.tracking.camera import Camera
from gfm.tracking.detect import Image, TagDetector
from gfm.tracking.files import read_camera
from gfm.tracking.frames import Frames, frames_of
from gfm.tracking.layout import TagLayout
from gfm.tracking.tracker import Look, Tracked, Tracker, TrackerState
from gfm_wire import Role

#: Takes what is known at a look, and when that was, s.
Listener = Callable[[Tracked, float], None]


@dataclass(frozen=True, kw_only=True)
class Following:
    """What is to be followed, with what, and who is told.

    Attributes:
        cameras: Files of the cameras, each with where its images come from.
        layout: The tags on the object.
        rate_hz: Of looks.
        out: A recording to write; None for none.
        address: Of the run whose bridge is told; None for none.
    """

    cameras: Sequence[tuple[Path, str]]
    layout: TagLayout
    rate_hz: float
    out: Path | None
    address: RunAddress | None


def follow(request: Following) -> None:
    """Follows until the first source ends, or somebody says so.

    Raises:
        BadInputError: files cannot be read, or the recording's name is taken.
        UnreachableError: there is no router.
    """
    cameras = [read_camera(path) for path, _ in request.cameras]
    if request.out is not None:
        check_free(request.out)
    clock = MonotonicClock()
    with ExitStack() as stack:
        sources: dict[str, Frames] = {}
        for camera, (_, source) in zip(cameras, request.cameras, strict=True):
            frames = frames_of(source, request.rate_hz, lambda: 1e-9 * clock.now_ns())
            sources[camera.name] = frames
            stack.callback(frames.close)
        listeners: list[Listener] = [_print]
        if request.address is not None:
            transport = stack.enter_context(request.address.open(Role.TRACKER, name="track"))
            listeners.append(PoseSender(transport, clock).tell)
        if request.out is not None:
            listeners.append(stack.enter_context(_recording(request.out)))
        is_paced = request.address is not None
        looks = _followed(cameras, request.layout, sources, clock, is_paced=is_paced)
        with suppress(KeyboardInterrupt):  # how one ends that follows live cameras
            for told, now_s in looks:
                for tell in listeners:
                    tell(told, now_s)


def _followed(
    cameras: Sequence[Camera],
    layout: TagLayout,
    sources: Mapping[str, Frames],
    clock: Clock,
    *,
    is_paced: bool,
) -> Iterator[tuple[Tracked, float]]:
    """Yields what is known at each look, and when that is, until a source has no more images.

    Args:
        cameras: All of them.
        layout: The tags on the object.
        sources: Of their images, by their names.
        clock: Of live images.
        is_paced: Whether images of files come in their own time, or as fast as can be.
    """
    tracker, state, detector = Tracker(cameras, layout), TrackerState(), TagDetector()
    is_live = any(frames.is_live for frames in sources.values())
    first_ns: int | None = None
    while True:
        looks = []
        for camera in cameras:
            if (newest := sources[camera.name].newest()) is None:
                return
            time_s, image = newest
            _check_size(camera, image)
            looks.append(Look(camera=camera.name, time_s=time_s, seen=detector.detect(image)))
        now_s = 1e-9 * clock.now_ns() if is_live else max(look.time_s for look in looks)
        if is_paced and not is_live:
            first_ns = clock.now_ns() - round(1e9 * now_s) if first_ns is None else first_ns
            clock.sleep_until_ns(first_ns + round(1e9 * now_s))
        told, state = tracker.step(now_s, looks, state)
        yield told, now_s


def _check_size(camera: Camera, image: Image) -> None:
    if (size := (image.shape[1], image.shape[0])) != camera.size_px:
        raise BadInputError(
            f"camera {camera.name}: an image of {size[0]} x {size[1]} px, expected "
            f"{camera.size_px[0]} x {camera.size_px[1]}"
        )


@contextmanager
def _recording(path: Path) -> Iterator[Listener]:
    """Yields what records every pose that is new; what an error cuts off is removed."""
    writer = RecordingWriter(path, about={"software": "gfm track"})

    def tell(told: Tracked, _now_s: float) -> None:
        if not told.fresh or told.pose is None or told.time_s is None:
            return
        stamp_ns = round(1e9 * told.time_s)
        place, turn = told.pose.position, told.pose.quaternion
        writer.write_object_pose(stamp_ns, place, turn, told.covariance)
        for camera, view in told.views.items():
            place, turn = view.pose.position, view.pose.quaternion
            writer.write_object_pose(stamp_ns, place, turn, view.covariance, camera)

    try:
        yield tell
    except BaseException:
        writer.discard()
        raise
    writer.close()


def _print(told: Tracked, _now_s: float) -> None:
    sys.stdout.write(json.dumps(_as_json(told)) + "\n")


def _as_json(told: Tracked) -> dict[str, Any]:
    """Returns what is known: m, rad, s; nothing that is not a number."""
    pose = told.pose
    return {
        "valid": told.valid,
        "age_s": told.age_s if pose is not None else None,
        "time_s": told.time_s,
        "position": None if pose is None else pose.position.tolist(),
        "quaternion": None if pose is None else pose.quaternion.tolist(),
        "covariance": None if told.covariance is None else told.covariance.tolist(),
        "velocity": None if told.velocity is None else told.velocity.tolist(),
        "smooth_velocity": None if told.smooth_velocity is None else told.smooth_velocity.tolist(),
        "cameras": list(told.used),
        "refused": dict(told.refused),
    }
