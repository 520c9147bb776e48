"""The command `gfm track`: calibrate cameras, and follow a tagged object with them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from gfm.core import BadInputError
from gfm.core.extras import needs
from gfm.launch.flags import add_endpoint, address_of
from gfm.recording.new_file import check_free, new_file

if TYPE_CHECKING:
    from gfm.sim.cell import FreeObject
    from gfm.tracking.calibrate import BoardView
    from gfm.tracking.files import CameraFile
    from gfm.tracking.layout import TagLayout

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_SUMMARY = "follow a tagged object with cameras"
_DESCRIPTION = """\
Follows an object that carries AprilTags (36h11) with calibrated cameras, each by itself, and
merges what they see into one pose. Needs the extra `tracking`.
"""
_OBJECTS = ("brick", "tee")


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm track`."""
    parser = subparsers.add_parser("track", help=_SUMMARY, description=_DESCRIPTION)
    tools = parser.add_subparsers(title="tools", metavar="TOOL", required=True)
    _add_calibrate(tools)
    _add_run(tools)
    _add_tags(tools)
    _add_draw(tools)


def _add_calibrate(tools: Subparsers) -> None:
    parser = tools.add_parser("calibrate", help="make a camera's file from images of a board")
    parser.add_argument("--images", type=Path, required=True, metavar="DIR")
    parser.add_argument("--board", type=Path, required=True, metavar="BOARD.toml")
    parser.add_argument("--name", required=True, help="of the camera")
    parser.add_argument(
        "--intrinsics",
        type=Path,
        metavar="CAMERA.toml",
        help="take these (default: find them from the images)",
    )
    parser.add_argument(
        "--places",
        type=Path,
        metavar="PLACES.toml",
        help="where the board was: find where the camera stands, too",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="CAMERA.toml")
    parser.set_defaults(run=_calibrate)


def _add_run(tools: Subparsers) -> None:
    parser = tools.add_parser(
        "run",
        help="print where the object is, one JSON object for each look",
        description="SOURCE is a folder of images, a video, a device's number or a camera's "
        "address. Ends when the first source does.",
    )
    parser.add_argument(
        "--camera",
        nargs=2,
        action="append",
        required=True,
        metavar=("CAMERA.toml", "SOURCE"),
        dest="cameras",
        help="once for each",
    )
    parser.add_argument(
        "--object",
        default="brick",
        metavar="NAME|LAYOUT.toml",
        help=f"its tags: {', '.join(_OBJECTS)}, or a file (default: %(default)s)",
    )
    parser.add_argument(
        "--rate-hz", type=float, default=30.0, help="of looks (default: %(default)g)"
    )
    parser.add_argument("--out", type=Path, metavar="NEW.mcap", help="record the poses, too")
    group = parser.add_argument_group("robot")
    group.add_argument(
        "--send", action="store_true", help="tell the robot bridge of a run where the object is"
    )
    add_endpoint(group, "--connect", "router of that run")
    parser.set_defaults(run=_run)


def _add_tags(tools: Subparsers) -> None:
    parser = tools.add_parser("tags", help="write tags as images to print")
    parser.add_argument("ids", nargs="+", type=int, metavar="ID")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.set_defaults(run=_tags)


def _add_draw(tools: Subparsers) -> None:
    parser = tools.add_parser("draw", help="write images of the simulated cell, to try this with")
    parser.add_argument("--object", choices=_OBJECTS, default="brick", help="(default: brick)")
    parser.add_argument("--looks", type=int, default=30, metavar="N", help="(default: 30)")
    parser.add_argument("--rate-hz", type=float, default=30.0, help="(default: 30)")
    parser.add_argument("--seed", type=int, default=0, help="of the pixels' noise (default: 0)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.set_defaults(run=_draw)


def _check_extra() -> None:
    with needs("tracking needs", "cv2", "tracking"):
        import gfm.tracking.detect  # noqa: F401


def _calibrate(arguments: argparse.Namespace) -> None:
    _check_extra()
    import msgspec

    from gfm.tracking import calibrate, files
    from gfm.tracking.frames import image_paths, read_image

    check_free(arguments.out)
    board = files.read(files.BoardFile, arguments.board)
    images = {path.name: read_image(path) for path in image_paths(arguments.images)}
    sizes = {(image.shape[1], image.shape[0]) for image in images.values()}
    if len(sizes) > 1:
        raise BadInputError(
            f"{arguments.images}: images of {len(sizes)} sizes, expected one: {sorted(sizes)}"
        )
    found = {name: calibrate.view_of(board, image) for name, image in images.items()}
    views = {name: view for name, view in found.items() if view is not None}
    camera = _intrinsics(arguments, sizes.pop(), list(views.values()))
    if arguments.places is not None:
        places = files.read(files.PlacesFile, arguments.places).places
        known = [(views[name], place.pose) for name, place in places.items() if name in views]
        stand = calibrate.mounting(camera, known)
        camera = msgspec.structs.replace(camera, mounting=stand)
    with new_file(arguments.out) as place:
        place.write_text(files.camera_text(camera), encoding="utf-8")
    sys.stdout.write(
        f"{arguments.out}: the board in {len(views)} of {len(images)} images, corners within "
        f"{camera.corner_noise_px:.2f} px\n"
    )


def _intrinsics(
    arguments: argparse.Namespace, size_px: tuple[int, int], views: Sequence[BoardView]
) -> CameraFile:
    """Returns the camera without a place: from a file, or from the images."""
    import msgspec

    from gfm.tracking import calibrate, files

    if arguments.intrinsics is None:
        return calibrate.intrinsics(arguments.name, size_px, views)
    told = files.read(files.CameraFile, arguments.intrinsics)
    if told.size_px != size_px:
        raise BadInputError(
            f"{arguments.images}: images of {size_px[0]} x {size_px[1]} px, expected "
            f"{told.size_px[0]} x {told.size_px[1]} ({arguments.intrinsics})"
        )
    return msgspec.structs.replace(told, name=arguments.name, mounting=None)


def _run(arguments: argparse.Namespace) -> None:
    _check_extra()
    from gfm.experiments.track_run import Following, follow

    _check_rate(arguments.rate_hz)
    follow(
        Following(
            cameras=[(Path(path), source) for path, source in arguments.cameras],
            layout=_layout(arguments.object),
            rate_hz=arguments.rate_hz,
            out=arguments.out,
            address=address_of(arguments) if arguments.send else None,
        )
    )


def _layout(name: str) -> TagLayout:
    from gfm.tracking.files import read_layout
    from gfm.tracking.layout import cell_layout

    if name in _OBJECTS:
        return cell_layout(cast("FreeObject", name))
    if not name.endswith(".toml"):
        raise BadInputError(f"--object {name}: expected {', '.join(_OBJECTS)} or a file .toml")
    return read_layout(Path(name))


def _tags(arguments: argparse.Namespace) -> None:
    _check_extra()
    from gfm.tracking.detect import tag_image
    from gfm.tracking.frames import write_image
    from gfm.tracking.layout import TAGS

    for number in arguments.ids:
        if not 0 <= number < TAGS:
            raise BadInputError(f"tag {number}, expected 0 to {TAGS - 1}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    for number in arguments.ids:
        path = arguments.out / f"tag_{number}.png"
        check_free(path)
        write_image(path, tag_image(number, module_px=64))
        sys.stdout.write(f"{path}\n")


def _draw(arguments: argparse.Namespace) -> None:
    _check_extra()
    from gfm.tracking.drawn_cell import write_cell

    _check_rate(arguments.rate_hz)
    if arguments.looks < 1:
        raise BadInputError(f"--looks is {arguments.looks}, expected at least 1")
    write_cell(arguments.out, arguments.object, arguments.looks, arguments.rate_hz, arguments.seed)
    sys.stdout.write(f"{arguments.out}: images, cameras' files, and truth.jsonl\n")


def _check_rate(rate_hz: float) -> None:
    if not rate_hz > 0.0:
        raise BadInputError(f"--rate-hz is {rate_hz:g}, expected more than 0")
