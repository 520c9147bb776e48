"""The pose of a tagged object: from corners, from several cameras, over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2")

from gfm.core import ConfigError, ManualClock
from gfm.experiments.track_send import KEY, PoseSender, as_message
from gfm.sim.cell import object_boxes
from gfm.tracking.cell_cameras import cell_cameras
from gfm.tracking.detect import Detection, TagDetector, tag_image
from gfm.tracking.fusion import Estimate, fuse
from gfm.tracking.layout import Tag, TagLayout, cell_layout
from gfm.tracking.projected import Faults, detection
from gfm.tracking.rendering import CellRenderer, NoRendererError, with_pixel_noise
from gfm.tracking.rigid import Pose, apart, looking, moved, pose_of, turn_by, turn_of
from gfm.tracking.sighting import candidates
from gfm.tracking.tracker import Look, Tracker, TrackerState
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import Ack, TrackedObject

CAMERAS = cell_cameras()
SURE = tuple(replace(camera, spread_m=1e-9, spread_rad=1e-9) for camera in CAMERAS)
PERIOD_S = 1.0 / 30.0
HALF = 0.4
POSE = pose_of(np.array([0.62, 0.03, 0.08, np.cos(HALF), 0.05, 0.0, np.sin(HALF)]))


def seen(camera, pose=POSE, kind="brick", rng=None, **faults) -> Detection:
    rng = np.random.default_rng(0) if rng is None else rng
    layout, boxes = cell_layout(kind), object_boxes(kind)
    found = detection(camera, layout, boxes, pose, Faults(**faults), rng)
    assert found is not None
    return found


def estimates(cameras, pose=POSE, **faults):
    layout, rng = cell_layout("brick"), np.random.default_rng(1)
    return [
        Estimate(
            camera=camera.name,
            candidates=candidates(camera, layout, seen(camera, pose, rng=rng, **faults)),
        )
        for camera in cameras
    ]


def test_a_turn_is_its_own_inverse_and_an_error_is_what_leads_there():
    vector = np.array([0.3, -1.2, 0.7])
    np.testing.assert_allclose(turn_of(turn_by(vector)), vector, atol=1e-12)
    error = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    np.testing.assert_allclose(apart(moved(POSE, error), POSE), error, atol=1e-12)
    np.testing.assert_allclose((POSE @ POSE.inverse).rotation, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("kind", ["brick", "tee"])
@pytest.mark.parametrize("camera", SURE, ids=[camera.name for camera in SURE])
def test_corners_without_noise_give_the_exact_pose(camera, kind):
    best = candidates(camera, cell_layout(kind), seen(camera, kind=kind))[0]
    np.testing.assert_allclose(apart(best.pose, POSE), np.zeros(6), atol=1e-6)


def test_distortion_is_taken_off():
    bent = replace(SURE[0], distortion=np.array([-0.2, 0.05, 1e-3, -5e-4, 0.01]))
    best = candidates(bent, cell_layout("brick"), seen(bent))[0]
    np.testing.assert_allclose(apart(best.pose, POSE), np.zeros(6), atol=1e-5)


def test_the_covariance_is_that_of_many_trials():
    camera, layout, rng = SURE[0], cell_layout("brick"), np.random.default_rng(2)
    poses = [candidates(camera, layout, seen(camera, rng=rng, noise_px=0.3))[0] for _ in range(300)]
    errors = np.array([apart(one.pose, POSE) for one in poses])
    told = np.sqrt(np.diag(poses[0].covariance))
    np.testing.assert_allclose(errors.std(axis=0), told, rtol=0.15)
    weighed = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(poses[0].covariance), errors)
    assert weighed.mean() == pytest.approx(6.0, rel=0.12)


def test_the_camera_s_own_spread_is_a_lever():
    camera = replace(CAMERAS[0], spread_m=1e-3, spread_rad=0.01)
    there = camera.pose.position + np.array([0.0, 0.0, -0.5])
    variances = np.diag(camera.spread_at(there))
    expected = [1e-6 + 0.005**2, 1e-6 + 0.005**2, 1e-6, 1e-4, 1e-4, 1e-4]
    np.testing.assert_allclose(variances, expected, rtol=1e-9)


def test_a_flat_tag_seen_from_afar_has_two_poses_and_a_second_camera_decides():
    """A tag of 2 cm tilted by 0.35 rad looks nearly as if it were tilted the other way."""
    tag = Tag(id=0, size_m=0.02, pose=Pose(rotation=np.eye(3), position=np.zeros(3)))
    layout = TagLayout(tags=(tag,))
    pose = Pose(rotation=turn_by(np.array([0.35, 0.0, 0.0])), position=np.array([0.6, 0.0, 0.05]))
    above = [
        replace(SURE[0], name=name, pose=looking(np.array(place), pose.position))
        for name, place in (("one", (0.62, 0.0, 1.2)), ("two", (0.6, -0.7, 0.7)))
    ]
    told = []
    for camera in above:
        found = Detection(ids=(0,), corners=camera.project(pose.of(tag.corners))[None])
        told.append(Estimate(camera=camera.name, candidates=candidates(camera, layout, found)))
    assert len(told[0].candidates) == 2
    turned = [np.linalg.norm(apart(one.pose, pose)[3:]) for one in told[0].candidates]
    assert min(turned) < 1e-3
    assert max(turned) > 0.3
    assert fuse(told[:1]) is None
    both = fuse(told)
    assert both is not None
    np.testing.assert_allclose(apart(both.pose, pose), np.zeros(6), atol=1e-3)


@pytest.mark.parametrize("bad", [0, 1])
def test_bad_tags_and_bad_corners_are_left_out(bad):
    camera, layout = SURE[0], cell_layout("brick")
    clean = seen(camera)
    corners = clean.corners.copy()
    corners[bad] += 12.0
    corners[2, 1] += 6.0
    best = candidates(camera, layout, Detection(ids=clean.ids, corners=corners))[0]
    np.testing.assert_allclose(apart(best.pose, POSE), np.zeros(6), atol=1e-5)
    assert best.tags == len(clean.ids) - 1


def test_unknown_tags_and_numbers_seen_twice_say_nothing():
    clean = seen(SURE[0])
    strange = Detection(ids=(500,), corners=clean.corners[:1])
    twice = Detection(ids=(0, 0), corners=clean.corners[:2])
    for found in (strange, twice, Detection(ids=(), corners=np.empty((0, 4, 2)))):
        assert candidates(SURE[0], cell_layout("brick"), found) == ()


def test_equal_cameras_are_averaged_and_are_surer_together():
    told = estimates(CAMERAS, noise_px=0.3)
    fused = fuse(told)
    assert fused is not None
    assert set(fused.used) == {"front", "left", "right"}
    for one in told:
        assert np.trace(fused.covariance) < np.trace(one.candidates[0].covariance)


@pytest.mark.parametrize("liar", range(3))
def test_a_camera_that_lies_is_rejected_by_the_two_others(liar):
    shift = np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved_away = [
        replace(camera, pose=moved(camera.pose, shift)) if number == liar else camera
        for number, camera in enumerate(CAMERAS)
    ]
    layout = cell_layout("brick")
    told = [
        Estimate(camera=camera.name, candidates=candidates(camera, layout, seen(real)))
        for camera, real in zip(moved_away, CAMERAS, strict=True)
    ]
    fused = fuse(told)
    assert fused is not None
    assert fused.rejected == (CAMERAS[liar].name,)
    np.testing.assert_allclose(apart(fused.pose, POSE), np.zeros(6), atol=1e-5)


def test_two_that_disagree_are_not_believed():
    layout = cell_layout("brick")
    lying = replace(CAMERAS[0], pose=moved(CAMERAS[0].pose, np.full(6, 0.03)))
    told = [
        Estimate(camera="front", candidates=candidates(lying, layout, seen(CAMERAS[0]))),
        Estimate(camera="left", candidates=candidates(CAMERAS[1], layout, seen(CAMERAS[1]))),
    ]
    assert fuse(told) is None


class Followed:
    """A tracker that is told where the object is, look by look."""

    def __init__(self):
        self.tracker, self.state = Tracker(CAMERAS, cell_layout("brick")), TrackerState()
        self.rng, self.time_s, self.told = np.random.default_rng(3), 0.0, None
        self.last = {}

    def look(self, pose, frozen=()):
        self.time_s += PERIOD_S
        for camera in CAMERAS:
            if camera.name not in frozen:
                self.last[camera.name] = seen(camera, pose, rng=self.rng, noise_px=0.3)
        looks = [
            Look(camera=name, time_s=self.time_s, seen=found) for name, found in self.last.items()
        ]
        self.told, self.state = self.tracker.step(self.time_s, looks, self.state)
        return self.told


def test_nothing_is_known_at_first_and_a_pose_is_believed_when_it_was_seen_three_times():
    one = Followed()
    assert [one.look(POSE).valid for _ in range(3)] == [False, False, True]
    assert one.told.age_s == 0.0


def test_cameras_that_stand_still_make_the_pose_old_and_then_invalid():
    one = Followed()
    for _ in range(5):
        one.look(POSE)
    names = tuple(camera.name for camera in CAMERAS)
    ages = [(one.look(POSE, frozen=names).age_s, one.told.valid) for _ in range(6)]
    np.testing.assert_allclose([age for age, _ in ages], PERIOD_S * np.arange(1, 7))
    assert [valid for _, valid in ages] == [True] * 4 + [False] * 2
    assert set(one.told.refused.values()) == {"frozen"}


def test_one_frozen_camera_is_left_out_and_the_others_go_on():
    one = Followed()
    for _ in range(5):
        one.look(POSE)
    later = moved(POSE, np.array([0.005, 0.0, 0.0, 0.0, 0.0, 0.0]))
    told = one.look(later, frozen=("front",))
    assert told.fresh
    assert told.refused == {"front": "frozen"}
    np.testing.assert_allclose(told.pose.position, later.position, atol=2e-3)


def test_a_jump_is_not_believed_at_once_but_in_the_end():
    one = Followed()
    for _ in range(5):
        one.look(POSE)
    away = moved(POSE, np.array([0.0, -0.1, 0.0, 0.0, 0.0, 0.0]))
    fresh = [one.look(away).fresh for _ in range(3)]
    assert fresh == [False, False, True]
    np.testing.assert_allclose(one.told.pose.position, away.position, atol=2e-3)
    assert one.told.velocity is None


def test_velocities_of_even_motion_are_found():
    one, step = Followed(), np.array([0.1, -0.05, 0.0, 0.0, 0.0, 0.5]) * PERIOD_S
    pose = POSE
    for _ in range(20):
        pose = moved(pose, step)
        one.look(pose)
    for told, place, turn in (
        (one.told.velocity, 0.05, 0.3),
        (one.told.smooth_velocity, 0.02, 0.2),
    ):
        np.testing.assert_allclose(told[:3], step[:3] / PERIOD_S, atol=place)
        np.testing.assert_allclose(told[3:], step[3:] / PERIOD_S, atol=turn)


def test_a_bridge_is_told_a_pose_with_its_date_and_by_camera_or_that_there_is_none():
    one, utc_ns = Followed(), 10**18
    assert as_message(one.look(POSE), one.time_s, utc_ns) == TrackedObject(stamp_ns=utc_ns)
    for _ in range(4):
        one.look(POSE)
    told = as_message(one.told, one.time_s + 0.02, utc_ns)
    assert told.stamp_ns == utc_ns - 20_000_000
    np.testing.assert_array_equal(told.pose.position, one.told.pose.position)
    np.testing.assert_array_equal(told.pose.covariance, told.pose.covariance.T)
    np.testing.assert_allclose(told.pose.covariance, one.told.covariance)
    assert set(told.views) == {camera.name for camera in CAMERAS}
    names = tuple(camera.name for camera in CAMERAS)
    for _ in range(6):
        one.look(POSE, frozen=names)
    assert as_message(one.told, one.time_s, utc_ns).pose is None


def test_a_bridge_that_says_no_or_nothing_is_one_line_and_sending_goes_on(caplog):
    hub, clock, one = MemoryHub(), ManualClock(10**9), Followed()
    sender = PoseSender(MemoryTransport(hub, clock=clock), clock)
    server = MemoryTransport(hub, name="bridge", clock=clock).serve(KEY)
    for answer in (False, False, True, True):
        sender.tell(one.look(POSE), one.time_s)
        request = server.receive()
        if answer:
            request.reply(Ack())
        else:
            request.refuse("the clocks differ")
    sender.tell(one.look(POSE), one.time_s)
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 2
    assert "the clocks differ" in said[0]
    assert said[1] == "the bridge takes the poses again"


def test_two_cameras_of_one_name_are_refused():
    with pytest.raises(ConfigError, match="two cameras have one name"):
        Tracker((CAMERAS[0], CAMERAS[0]), cell_layout("brick"))


def test_a_printed_tag_is_found_where_it_is():
    page = np.pad(tag_image(7, 10), 40, constant_values=255)
    found = TagDetector().detect(page)
    assert found.ids == (7,)
    # 40 of margin and 10 of rim; pixel centres are whole, edges lie between them.
    expected = [[49.5, 49.5], [129.5, 49.5], [129.5, 129.5], [49.5, 129.5]]
    np.testing.assert_allclose(found.corners[0], expected, atol=0.6)


@pytest.mark.parametrize("kind", ["brick", "tee"])
def test_images_show_what_is_projected(kind):
    layout, rng = cell_layout(kind), np.random.default_rng(4)
    try:
        renderer = CellRenderer(kind, layout, CAMERAS)
    except NoRendererError as exc:
        pytest.skip(str(exc))
    errors, told, expected = [], [], 0
    with renderer:
        for camera in CAMERAS:
            found = TagDetector().detect(
                with_pixel_noise(renderer.draw(camera.name, POSE), 2.0, rng)
            )
            projected = seen(camera, kind=kind)
            expected += len(projected.ids)
            for number in set(found.ids) & set(projected.ids):
                one, other = found.ids.index(number), projected.ids.index(number)
                errors.append(found.corners[one] - projected.corners[other])
            told.append(Estimate(camera=camera.name, candidates=candidates(camera, layout, found)))
    assert len(errors) >= expected - 1
    assert np.sqrt(np.mean(np.square(errors))) < 0.3
    fused = fuse(told)
    assert fused is not None
    error = apart(fused.pose, POSE)
    assert np.linalg.norm(error[:3]) < 2e-3
    assert np.linalg.norm(error[3:]) < np.radians(0.5)
