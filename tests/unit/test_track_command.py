"""`gfm track` as its users meet it: calibrations, poses, and files that cannot be."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("cv2")

import cv2
from mcap.reader import make_reader

from gfm.cli import main
from gfm.tracking.calibrate import make_board
from gfm.tracking.camera import camera_matrix
from gfm.tracking.detect import tag_image
from gfm.tracking.files import BoardFile, CameraFile, Mounting, camera_text, read, read_camera
from gfm.tracking.frames import LiveFrames, frames_of, write_image
from gfm.tracking.layout import cell_layout
from gfm.tracking.rigid import Pose, apart, looking, pose_of, turn_by

SIZE, FOCAL_PX = (640, 480), 600.0
CENTRE = np.array([319.5, 239.5])
MATRIX = camera_matrix(np.full(2, FOCAL_PX), CENTRE)
PX_PER_M = 4000.0
STAND = looking(np.array([0.9, 0.1, 0.6]), np.array([0.5, 0.0, 0.0]))


def board_text(kind):
    return f'kind = "{kind}"\ncolumns = 6\nrows = 5\nsquare_m = 0.04\ntag_m = 0.03\n'


def flat_image(picture, pose_in_camera, corner, side_m):
    """Returns what the camera sees of a picture on a plane whose upper left corner is `corner`."""
    height, width = picture.shape
    scale = side_m / width
    to_plane = np.array(
        [[scale, 0, 0.5 * scale + corner[0]], [0, scale, 0.5 * scale + corner[1]], [0, 0, 1]]
    )
    plane = np.column_stack([pose_in_camera.rotation[:, :2], pose_in_camera.position])
    warp = MATRIX @ plane @ to_plane
    return cv2.warpPerspective(picture, warp, SIZE, flags=cv2.INTER_AREA, borderValue=128), (
        height,
        width,
    )


def write_board(folder, kind):
    """Writes eight images of a board, and where it was in the base frame."""
    told = BoardFile(kind=kind, columns=6, rows=5, square_m=0.04, tag_m=0.03)
    board = make_board(told)
    gap = 0.01
    width_m, height_m = (0.24, 0.2) if kind == "charuco" else (0.24 - gap, 0.2 - gap)
    size = (round(width_m * PX_PER_M), round(height_m * PX_PER_M))
    picture = np.asarray(board.generateImage(size, marginSize=0))
    picture = np.pad(picture, 40, constant_values=255)
    side_m = picture.shape[1] / PX_PER_M
    corner = (-40 / PX_PER_M, -40 / PX_PER_M)
    rng, places = np.random.default_rng(0), []
    for number in range(8):
        tilt = turn_by(rng.uniform(-0.5, 0.5, 3))
        middle = np.array([0.12, 0.1, 0.0])
        spot = np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(0.4, 0.55)])
        pose = Pose(rotation=tilt, position=spot - tilt @ middle)
        image, _ = flat_image(picture, pose, corner, side_m)
        write_image(folder / f"{number}.png", image)
        at = STAND @ pose
        places.append(
            f'[places."{number}.png"]\nposition_m = {at.position.tolist()}\n'
            f"quaternion = {at.quaternion.tolist()}\n"
        )
    return "\n".join(places)


@pytest.mark.parametrize("kind", ["charuco", "tags"])
def test_a_camera_is_calibrated_and_found_where_it_stands(tmp_path, capsys, kind):
    images = tmp_path / "images"
    images.mkdir()
    places, board, out = (tmp_path / name for name in ("places.toml", "board.toml", "left.toml"))
    places.write_text(write_board(images, kind))
    board.write_text(board_text(kind))
    words = ["--images", images, "--board", board, "--places", places, "--name", "left"]
    assert main(["track", "calibrate", *map(str, words), "--out", str(out)]) == 0
    assert "the board in 8 of 8 images" in capsys.readouterr().out
    camera = read_camera(out)
    np.testing.assert_allclose(camera.focal_px, FOCAL_PX, rtol=0.01)
    np.testing.assert_allclose(camera.centre_px, CENTRE, atol=6.0)
    error = apart(camera.pose, STAND)
    assert np.linalg.norm(error[:3]) < 6e-3
    assert np.linalg.norm(error[3:]) < 0.012
    assert 0.0 < camera.spread_m < 5e-3


def camera_file(name="front", **changed):
    place = {"position_m": (0.9, 0.1, 0.6), "quaternion": (1.0, 0.0, 0.0, 0.0)}
    told = {
        "name": name,
        "size_px": SIZE,
        "focal_px": (FOCAL_PX, FOCAL_PX),
        "centre_px": (319.5, 239.5),
        "mounting": Mounting(**place, spread_m=1e-3, spread_rad=2e-3),
    }
    return CameraFile(**{**told, **changed})


def test_a_calibration_is_read_as_it_was_written(tmp_path):
    path, told = tmp_path / "camera.toml", camera_file(distortion=(-0.1, 0.02, 1e-3, 2e-4, 0.0))
    path.write_text(camera_text(told))
    assert read(CameraFile, path) == told


GOOD = camera_text(camera_file())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = ", "not TOML"),
        (GOOD.replace("focal_px", "focal"), "unknown field `focal`"),
        (GOOD.replace("[600.0, 600.0]", "[600.0, -1.0]"), "expected `float` > 0"),
        (GOOD.replace("[1.0, 0.0", "[2.0, 0.0"), "length 2"),
        (GOOD.replace("spread_m = 0.001", "spread_m = 0.0"), "> 0"),
        (GOOD.partition("[mounting]")[0], "no table mounting"),
    ],
)
def test_a_camera_s_file_that_cannot_be_is_one_line(tmp_path, capsys, text, said):
    path = tmp_path / "camera.toml"
    path.write_text(text)
    assert main(["track", "run", "--camera", str(path), str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"error: {path}")
    assert said.lower() in lines[0].lower()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--object", "cube"), "expected brick, tee or a file .toml"),
        (("--object", "absent.toml"), "absent.toml: cannot be read"),
        (("--rate-hz", "0"), "--rate-hz is 0, expected more than 0"),
        ((), "no image; expected a folder"),
    ],
)
def test_what_cannot_be_followed_is_one_line_and_leaves_nothing(tmp_path, capsys, words, said):
    path, empty = tmp_path / "camera.toml", tmp_path / "empty"
    empty.mkdir()
    path.write_text(GOOD)
    out = tmp_path / "new.mcap"
    asked = ["track", "run", "--camera", str(path), str(empty), "--out", str(out), *words]
    assert main(asked) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not list(tmp_path.glob("*.mcap*"))


def test_a_layout_with_a_number_twice_is_refused(tmp_path, capsys):
    camera, layout = tmp_path / "camera.toml", tmp_path / "tags.toml"
    camera.write_text(GOOD)
    tag = "[[tags]]\nid = 3\nsize_m = 0.04\nplace = {position_m = [0.0, 0.0, 0.0]}\n"
    layout.write_text(2 * tag)
    words = ["--camera", str(camera), str(tmp_path), "--object", str(layout)]
    assert main(["track", "run", *words]) == 2
    assert "tag 3 is there twice" in capsys.readouterr().err


def test_images_in_a_folder_become_poses_and_a_recording(tmp_path, capsys):
    camera, images, out = tmp_path / "camera.toml", tmp_path / "images", tmp_path / "new.mcap"
    images.mkdir()
    x, y, z = STAND.position.tolist()
    stand = Mounting(
        position_m=(x, y, z),
        quaternion=tuple(STAND.quaternion.tolist()),
        spread_m=1e-4,
        spread_rad=1e-4,
    )
    camera.write_text(camera_text(camera_file(mounting=stand)))
    layout = cell_layout("brick")
    place = pose_of(np.array([0.5, 0.0, 0.03, np.cos(0.4), 0.0, 0.0, np.sin(0.4)]))
    rng = np.random.default_rng(0)
    for number in range(6):
        image = np.full(SIZE[::-1], 128, np.uint8)
        for tag in layout.tags[:2]:  # on its top
            in_camera = STAND.inverse @ place @ tag.pose
            # The picture's plane: y down, so that its axes are those of an image.
            plane = Pose(
                rotation=in_camera.rotation @ np.diag([1.0, -1.0, -1.0]),
                position=in_camera.position,
            )
            side = 1.25 * tag.size_m
            seen, _ = flat_image(tag_image(tag.id, 16), plane, (-side / 2, -side / 2), side)
            mask, _ = flat_image(np.full((160, 160), 255, np.uint8), plane, (-side / 2,) * 2, side)
            image = np.where(mask == 255, seen, image)
        noisy = np.clip(image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)
        write_image(images / f"{number}.png", noisy)
    words = ["--camera", str(camera), str(images), "--rate-hz", "20", "--out", str(out)]
    assert main(["track", "run", *words]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["valid"] for line in lines] == [False, False, True, True, True, True]
    assert lines[-1]["time_s"] == pytest.approx(0.25)
    np.testing.assert_allclose(lines[-1]["position"], place.position, atol=5e-3)
    with out.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("/object_pose") == 4
    assert topics.count("/object_pose_with_covariance") == 4
    assert topics.count("/camera/front/object_pose_with_covariance") == 4


def test_tags_are_written_to_print(tmp_path, capsys):
    assert main(["track", "tags", "0", "5", "--out", str(tmp_path)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert main(["track", "tags", "587", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == "error: tag 587, expected 0 to 586\n"


def test_images_without_a_board_make_no_camera(tmp_path, capsys):
    board = tmp_path / "board.toml"
    board.write_text(board_text("charuco"))
    write_image(tmp_path / "grey.png", np.full(SIZE[::-1], 128, np.uint8))
    words = ["--images", str(tmp_path), "--board", str(board), "--name", "left"]
    out = tmp_path / "left.toml"
    assert main(["track", "calibrate", *words, "--out", str(out)]) == 2
    assert "the board is seen in 0 images, expected at least 5" in capsys.readouterr().err
    assert not out.exists()


def test_an_image_of_another_size_leaves_no_recording(tmp_path, capsys):
    camera, out = tmp_path / "camera.toml", tmp_path / "new.mcap"
    camera.write_text(GOOD)
    write_image(tmp_path / "small.png", np.full((48, 64), 128, np.uint8))
    words = ["--camera", str(camera), str(tmp_path), "--out", str(out)]
    assert main(["track", "run", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "error: camera front: an image of 64 x 48 px, expected 640 x 480"
    assert not list(tmp_path.glob("*.mcap*"))


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for shade in (0, 60, 120, 180, 240):
        writer.write(np.full((48, 64, 3), shade, np.uint8))
    writer.release()
    return path


def test_a_video_has_its_own_times(video):
    frames = frames_of(str(video), 30.0, lambda: 0.0)
    told = [frames.newest() for _ in range(6)]
    frames.close()
    assert told[5] is None
    np.testing.assert_allclose([one[0] for one in told[:5]], 0.04 * np.arange(5), atol=1e-3)
    np.testing.assert_allclose([one[1].mean() for one in told[:5]], [0, 60, 120, 180, 240], atol=3)


def test_a_camera_that_is_gone_gives_its_last_image_as_old_as_it_is(video):
    times = iter(range(100))
    frames = LiveFrames(str(video), lambda: float(next(times)), wait_s=0.01)
    frames._thread.join()
    last, again = frames.newest(), frames.newest()
    frames.close()
    assert last[0] == again[0] == 4.0
    assert last[1].mean() == pytest.approx(240, abs=3)


def test_the_drawn_cell_is_tracked(tmp_path, capsys):
    cell = tmp_path / "cell"
    status = main(["track", "draw", "--looks", "5", "--out", str(cell)])
    if status == 1:
        pytest.skip(capsys.readouterr().err)
    assert status == 0
    capsys.readouterr()
    words = [
        word
        for name in ("front", "left", "right")
        for word in ("--camera", str(cell / f"{name}.toml"), str(cell / name))
    ]
    assert main(["track", "run", *words]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    real = json.loads((cell / "truth.jsonl").read_text().splitlines()[-1])
    assert told["valid"]
    assert told["time_s"] == pytest.approx(real["time_s"])
    np.testing.assert_allclose(told["position"], real["position"], atol=2e-3)
    assert abs(np.dot(told["quaternion"], real["quaternion"])) > np.cos(np.radians(0.5))
