"""How well the object is tracked in the cell: corners projected with faults, and images drawn.

    python benchmarks/tracking.py --frames 21000 --images 1002 --out docs/results/tracking.md

Frames: an object that is pushed about for minutes, seen by three cameras whose calibration is off,
with noise, bad tags and lost images. Images: poses at random, drawn and searched for tags, against
the same corners projected. Everything random comes from the seed.
"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gfm.sim.cell import FreeObject, object_boxes, object_rest_position
from gfm.tracking.cell_cameras import PLACE_OFF_M, TURN_OFF_RAD, cell_cameras, displaced
from gfm.tracking.detect import TagDetector
from gfm.tracking.fusion import Estimate, fuse
from gfm.tracking.layout import TagLayout, cell_layout
from gfm.tracking.projected import Faults, detection
from gfm.tracking.rendering import CellRenderer, with_pixel_noise
from gfm.tracking.rigid import Pose, apart, turn_by
from gfm.tracking.sighting import candidates
from gfm.tracking.tracker import Look, Tracked, Tracker, TrackerState

RATE_HZ = 30.0
#: After so many frames another object, other calibration errors and another path.
STRETCH = 1000
FAULTS = Faults(noise_px=0.3, bad_tags=0.1, lost=0.3)
#: Limits: what a pushed object must be tracked within.
LIMITS = {"p95_mm": 4.0, "p95_deg": 1.0, "max_mm": 15.0, "max_deg": 5.0}
#: How far images and projections may differ: corners as their noise, poses by half of a limit.
LIMITS |= {"corners_rms_px": 0.3, "tags_missed": 0.03, "poses_p95_mm": 2.0, "poses_p95_deg": 0.5}
PIXEL_NOISE = 2.0  # grey levels


@dataclass(frozen=True, kw_only=True)
class Way:
    """A smooth path of chance: sums of two sines for each of six coordinates.

    Attributes:
        rest: Its middle: place, and turn about the vertical, shape (4,).
        sizes: Of every sine, m and rad, shape (2, 6).
        rates: rad/s, shape (2, 6).
        phases: rad, shape (2, 6).
    """

    rest: np.ndarray
    sizes: np.ndarray
    rates: np.ndarray
    phases: np.ndarray

    def coordinates(self, time_s: float) -> np.ndarray:
        """Returns place and tilts against rest, shape (6,)."""
        return np.sum(self.sizes * np.sin(self.rates * time_s + self.phases), axis=0)

    def pose(self, time_s: float) -> Pose:
        """Returns the pose at a time."""
        at = self.coordinates(time_s)
        rotation = turn_by(np.array([0.0, 0.0, self.rest[3] + at[5]])) @ turn_by(
            np.array([*at[3:5], 0.0])
        )
        return Pose(rotation=rotation, position=self.rest[:3] + at[:3])

    def velocity(self, time_s: float) -> np.ndarray:
        """Returns m/s and rad/s about the base frame's axes, shape (6,)."""
        step = 1e-4
        later, earlier = self.pose(time_s + step), self.pose(time_s - step)
        return apart(later, earlier) / (2.0 * step)


def way(kind: FreeObject, rng: np.random.Generator) -> Way:
    """Returns a path over the basket's floor, at up to 0.3 m/s, any way round, tilted a little."""
    x, y, z = object_rest_position(kind)
    most = np.array([0.03, 0.03, 0.01, 0.05, 0.05, 0.6])
    return Way(
        rest=np.array([x, y, z + 0.02, rng.uniform(-np.pi, np.pi)]),
        sizes=most * rng.uniform(0.2, 1.0, (2, 6)),
        rates=rng.uniform(0.2, 2.0, (2, 6)),
        phases=rng.uniform(0.0, 2.0 * np.pi, (2, 6)),
    )


@dataclass
class Errors:
    """What was collected: of fresh poses mm, degrees, and how they compare with their spread."""

    frames: int = 0
    valid: int = 0
    blind: int = 0
    place_mm: list[float] = field(default_factory=list)
    turn_deg: list[float] = field(default_factory=list)
    weighed: list[float] = field(default_factory=list)
    cameras: list[int] = field(default_factory=list)
    plain: list[np.ndarray] = field(default_factory=list)
    smooth: list[np.ndarray] = field(default_factory=list)

    def add(self, told: Tracked, real: Way, seen: int) -> None:
        """Counts one frame."""
        self.frames += 1
        self.valid += told.valid
        self.blind += seen == 0
        if not told.fresh or told.pose is None or told.covariance is None or told.time_s is None:
            return
        error = apart(told.pose, real.pose(told.time_s))
        self.place_mm.append(1e3 * float(np.linalg.norm(error[:3])))
        self.turn_deg.append(float(np.degrees(np.linalg.norm(error[3:]))))
        self.weighed.append(float(error @ np.linalg.solve(told.covariance, error)))
        self.cameras.append(len(told.used))
        truth = real.velocity(told.time_s)
        if told.velocity is not None and told.smooth_velocity is not None:
            self.plain.append(told.velocity - truth)
            self.smooth.append(told.smooth_velocity - truth)


def followed(frames: int, rng: np.random.Generator) -> Errors:
    """Returns the errors over so many frames, half of them of each object."""
    errors = Errors()
    kinds: tuple[FreeObject, ...] = ("brick", "tee")
    for stretch in range(-(-frames // STRETCH)):
        kind = kinds[stretch % 2]
        _follow(kind, min(STRETCH, frames - stretch * STRETCH), errors, rng)
    return errors


def _follow(kind: FreeObject, frames: int, errors: Errors, rng: np.random.Generator) -> None:
    layout, boxes, real = cell_layout(kind), object_boxes(kind), way(kind, rng)
    believed = cell_cameras()
    cameras = [displaced(camera, rng) for camera in believed]
    tracker, state = Tracker(believed, layout), TrackerState()
    for number in range(frames):
        time_s = number / RATE_HZ
        looks = [
            Look(camera=camera.name, time_s=time_s, seen=seen)
            for camera in cameras
            if (seen := detection(camera, layout, boxes, real.pose(time_s), FAULTS, rng))
            is not None
        ]
        told, state = tracker.step(time_s, looks, state)
        errors.add(told, real, len(looks))


@dataclass
class Agreement:
    """Images against projected corners.

    `px` has the differences of each tag's corners, (4, 2); `apart` those of the poses that images
    and projected corners are fused to, the latter being the truth.
    """

    images: int = 0
    tags: int = 0
    missed: int = 0
    extra: int = 0
    px: list[np.ndarray] = field(default_factory=list)
    apart: list[np.ndarray] = field(default_factory=list)


def drawn(images: int, rng: np.random.Generator) -> Agreement:
    """Returns how images (of all three cameras, of both objects) compare with projections."""
    found = Agreement()
    kinds: tuple[FreeObject, ...] = ("brick", "tee")
    cameras = cell_cameras()
    views = -(-images // len(cameras))
    for kind, times in zip(kinds, (views - views // 2, views // 2), strict=True):
        layout = cell_layout(kind)
        with CellRenderer(kind, layout, cameras) as renderer:
            for _ in range(times):
                pose = way(kind, rng).pose(0.0)
                _draw(kind, layout, renderer, pose, found, rng)
    return found


def _draw(
    kind: FreeObject,
    layout: TagLayout,
    renderer: CellRenderer,
    pose: Pose,
    found: Agreement,
    rng: np.random.Generator,
) -> None:
    cameras, detector, boxes = cell_cameras(), TagDetector(), object_boxes(kind)
    seen, told = [], []
    for camera in cameras:
        image = with_pixel_noise(renderer.draw(camera.name, pose), PIXEL_NOISE, rng)
        one, other = detector.detect(image), detection(camera, layout, boxes, pose, Faults(), rng)
        if other is None:
            raise AssertionError("nothing is lost without faults")
        both = sorted(set(one.ids) & set(other.ids))
        found.images += 1
        found.tags += len(other.ids)
        found.missed += len(other.ids) - len(both)
        found.extra += len(one.ids) - len(both)
        found.px += [
            one.corners[one.ids.index(i)] - other.corners[other.ids.index(i)] for i in both
        ]
        for detected, estimates in ((one, seen), (other, told)):
            if poses := candidates(camera, layout, detected):
                estimates.append(Estimate(camera=camera.name, candidates=poses))
    fused = [fuse(estimates) for estimates in (seen, told)]
    if fused[0] is not None and fused[1] is not None:
        found.apart.append(apart(fused[0].pose, fused[1].pose))


def _line(what: str, *values: object) -> str:
    return f"| {what} | " + " | ".join(str(value) for value in values) + " |"


def _spans(lengths: np.ndarray) -> list[str]:
    middle, most = np.percentile(lengths, [50, 95])
    return [f"{middle:.2f}", f"{most:.2f}", f"{lengths.max():.2f}"]


def _frames_lines(errors: Errors) -> Iterator[str]:
    place, turn = np.array(errors.place_mm), np.array(errors.turn_deg)
    cameras, weighed = np.array(errors.cameras), np.array(errors.weighed)
    yield "| | poses | mm: median | 95 % | most | degrees: median | 95 % | most | d² |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for name, chosen in (
        ("all", cameras > 0),
        *((f"by {n} camera{'s' if n > 1 else ''}", cameras == n) for n in (1, 2, 3)),
    ):
        if chosen.any():
            spans = (*_spans(place[chosen]), *_spans(turn[chosen]))
            yield _line(name, int(chosen.sum()), *spans, f"{weighed[chosen].mean():.1f}")
    yield ""
    yield "| | share of the frames |"
    yield "|---|---|"
    yield _line("a new pose", f"{100 * len(place) / errors.frames:.1f} %")
    yield _line("a valid pose", f"{100 * errors.valid / errors.frames:.1f} %")
    yield _line("no image at all", f"{100 * errors.blind / errors.frames:.1f} %")
    yield ""
    yield "| velocity, root mean square error | mm/s | rad/s |"
    yield "|---|---|---|"
    for name, rows in (("difference of two poses", errors.plain), ("filtered", errors.smooth)):
        squares = np.array(rows) ** 2
        each = [float(np.sqrt(squares[:, part].sum(1).mean())) for part in _PARTS]
        yield _line(name, f"{1e3 * each[0]:.0f}", f"{each[1]:.2f}")


_PARTS = (slice(3), slice(3, 6))


def _limit_lines(errors: Errors, found: Agreement | None) -> Iterator[str]:
    """Yields each limit, what was measured, and whether it is kept."""
    measured = {
        "p95_mm": np.percentile(errors.place_mm, 95),
        "p95_deg": np.percentile(errors.turn_deg, 95),
        "max_mm": max(errors.place_mm),
        "max_deg": max(errors.turn_deg),
    }
    if found is not None:
        distance = np.array(found.apart)
        measured["corners_rms_px"] = float(np.sqrt(np.mean(np.square(found.px))))
        measured["tags_missed"] = found.missed / found.tags
        measured["poses_p95_mm"] = np.percentile(1e3 * np.linalg.norm(distance[:, :3], axis=1), 95)
        turns = np.degrees(np.linalg.norm(distance[:, 3:], axis=1))
        measured["poses_p95_deg"] = np.percentile(turns, 95)
    yield "| | measured | at most | |"
    yield "|---|---|---|---|"
    for name, value in measured.items():
        kept = "kept" if value <= LIMITS[name] else "BROKEN"
        yield _line(name, f"{value:.3g}", f"{LIMITS[name]:g}", kept)


def _images_lines(found: Agreement) -> Iterator[str]:
    px = np.array(found.px)
    yield "| | |"
    yield "|---|---|"
    yield _line("images", found.images)
    yield _line("tags that should be seen", found.tags)
    yield _line("of these not found", found.missed)
    yield _line("found beyond them", found.extra)
    yield _line("corners, root mean square of a coordinate", f"{np.sqrt(np.mean(px**2)):.3f} px")
    yield _line("corners, 99 % within", f"{np.percentile(np.linalg.norm(px, axis=2), 99):.2f} px")
    yield _line("corners, furthest", f"{np.linalg.norm(px, axis=2).max():.2f} px")
    errors = np.array(found.apart)
    mm = 1e3 * np.linalg.norm(errors[:, :3], axis=1)
    degrees = np.degrees(np.linalg.norm(errors[:, 3:], axis=1))
    for values, unit in ((mm, "mm"), (degrees, "degrees")):
        spans = f"{np.percentile(values, 95):.2f} {unit} (95 %), {values.max():.2f} (most)"
        yield _line(f"fused poses apart, {unit}", spans)
    mean = ", ".join(f"{value:.2f}" for value in 1e3 * errors[:, :3].mean(axis=0))
    yield _line("their mean, x, y, z", f"{mean} mm")


def report(errors: Errors, found: Agreement | None, words: str, seed: int) -> str:
    """Returns the page."""
    lines = ["# Tracking the object", "", f"```\n{words}\n```", ""]
    lines += [
        f"Seed {seed}, {platform.machine()}. Three cameras of 1280 x 720 pixels, 0.67 m from the "
        "basket's middle, 30 images a second.",
        "",
        "## Limits",
        "",
        *_limit_lines(errors, found),
        "",
        f"## {errors.frames} frames of projected corners",
        "",
        f"Noise of {FAULTS.noise_px} px, {100 * FAULTS.bad_tags:.0f} % bad tags (another number, "
        "corners in another order, shifted, torn), "
        f"{100 * FAULTS.lost:.0f} % of the images lost, each camera {1e3 * PLACE_OFF_M:.0f} mm and "
        f"{np.degrees(TURN_OFF_RAD):.1f} degrees off in a direction of chance. Every {STRETCH} "
        "frames the cameras' errors and the path are drawn anew; brick and tee take turns. Errors "
        "are those of every new pose that was believed; d² is the squared Mahalanobis distance "
        "from the truth, 6 where covariances are right.",
        "",
        *_frames_lines(errors),
    ]
    if found is not None:
        lines += [
            "",
            f"## {found.images} images",
            "",
            f"Drawn by MuJoCo, with noise of {PIXEL_NOISE:g} grey levels on each pixel, the arm "
            "where it is ready; cameras where they are believed to be. Compared with projected "
            "corners without noise.",
            "",
            *_images_lines(found),
            "",
            "The mean is a bias of drawing and detector together, of a part of a pixel: all "
            "cameras look down, so that it adds up along z.",
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measures, and writes or prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=21_000, metavar="N")
    parser.add_argument("--images", type=int, default=1002, metavar="N", help="0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="(default: print)")
    asked = parser.parse_args()
    first, second = np.random.default_rng(asked.seed).spawn(2)
    errors = followed(asked.frames, first)
    found = drawn(asked.images, second) if asked.images else None
    words = f"python benchmarks/tracking.py --frames {asked.frames} --images {asked.images}"
    page = report(errors, found, words, asked.seed)
    if asked.out is None:
        print(page)
    else:
        asked.out.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
