"""A stream to Rerun's viewer: curves, the arm in 3D, and what the bridge did."""

from __future__ import annotations

import math
import socket
from collections.abc import Mapping
from typing import Any, final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from typing_extensions import override

from gfm.core import BadInputError, CommandKind
from gfm.live.viewer import Viewer
from gfm.recording import periods, schemas

Message = Mapping[str, Any]

_APPLICATION = "gfm_watch"
_TIMELINE = "stamp"
_CONNECT_S = 2.0
#: Length of the axes that stand for the object, m.
_AXES_M = 0.1


def connected(host: str, port: int) -> RerunStream:
    """Returns a stream to a viewer that is open.

    Raises:
        BadInputError: there is no viewer.
    """
    try:
        socket.create_connection((host, port), _CONNECT_S).close()
    except OSError as exc:
        raise BadInputError(
            f"no Rerun viewer at {host}:{port} ({exc.strerror or exc}); expected one that is open: "
            f"rerun --bind 127.0.0.1 --port {port}"
        ) from exc
    stream = rr.RecordingStream(_APPLICATION)
    name = f"[{host}]" if ":" in host else host
    stream.connect_grpc(f"rerun+http://{name}:{port}/proxy", default_blueprint=blueprint())
    return RerunStream(stream)


def blueprint() -> rrb.Blueprint:
    """Returns how it is laid out at first: the arm, beside curves and what the bridge did."""
    curves = [
        rrb.TimeSeriesView(
            name=kind,
            origin="/",
            contents=[
                f"joint_states/{kind}",
                f"joint_command/{kind}",
                f"joint_command_requested/{kind}",
            ],
        )
        for kind in CommandKind
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(name="arm", origin="/"),
                rrb.TextLogView(name="bridge", origin="bridge"),
            ),
            rrb.Vertical(*curves),
        ),
        collapse_panels=True,
    )


@final
class RerunStream(Viewer):
    """Writes to one recording of Rerun, which its viewer shows as it grows.

    Args:
        stream: To the viewer, or into a file.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._named: set[str] = set()
        self._why = ""

    @override
    def write_message(
        self, topic: str, kind: schemas.MessageType, message: Message, stamp_ns: int
    ) -> None:
        self._stream.set_time(_TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        where = topic.removeprefix("/")
        match kind:
            case schemas.JOINT_STATE:
                self._joints(where, message)
            case schemas.REASON_MASK:
                self._curve(where, [message["data"]])
            case schemas.POSE:
                self._pose(where, message["pose"])
            case schemas.TRANSFORMS:
                self._frames(message)
            case schemas.TEXT:
                description = message["data"].encode()
                self._stream.log_file_from_contents("robot.urdf", description, static=True)
            case periods.SAFETY:
                self._reasons(where, message)
            case periods.TIMING:
                self._times(where, message)
            case _:  # a pose's covariance has no picture of its own here
                self._pose(where, message["pose"]["pose"])

    @override
    def welcome(self) -> None:
        """Does nothing: a viewer has what came before it from the stream."""

    @override
    def close(self) -> None:
        self._stream.disconnect()

    def _joints(self, where: str, message: Message) -> None:
        for kind in CommandKind:
            if message[kind]:
                self._curve(f"{where}/{kind}", message[kind], message["name"])

    def _curve(self, where: str, values: list[float], names: list[str] | None = None) -> None:
        if names is not None and where not in self._named:
            self._named.add(where)
            words = where.partition("/")[0].removeprefix("joint_").replace("_", " ")
            labels = [f"{name} {words}" for name in names]
            self._stream.log(where, rr.SeriesLines(names=labels), static=True)
        self._stream.log(where, rr.Scalars(values))

    def _frames(self, message: Message) -> None:
        for one in message["transforms"]:
            child, place = one["child_frame_id"], one["transform"]
            where = f"tf/{child}"
            frames = (one["header"]["frame_id"], child)
            self._place(where, place["translation"], place["rotation"], frames)

    def _pose(self, where: str, pose: Message) -> None:
        if where not in self._named:
            self._named.add(where)
            self._stream.log(where, rr.TransformAxes3D(_AXES_M), static=True)
        self._place(where, pose["position"], pose["orientation"], ("base", where))

    def _place(self, where: str, place: Message, turn: Message, frames: tuple[str, str]) -> None:
        parent, child = frames
        transform = rr.Transform3D(
            translation=[place[axis] for axis in "xyz"],
            quaternion=rr.Quaternion(xyzw=[turn[axis] for axis in "xyzw"]),
            parent_frame=parent,
            child_frame=child,
        )
        self._stream.log(where, transform)

    def _reasons(self, where: str, message: Message) -> None:
        """Logs why commands are changed, whenever that is another reason than before."""
        bits = [name for name, value in message.items() if value is True]
        why = ", ".join(bits) or "as asked for"
        if why != self._why:
            self._why = why
            level = rr.TextLogLevel.WARN if bits else rr.TextLogLevel.INFO
            self._stream.log(where, rr.TextLog(why, level=level))

    def _times(self, where: str, message: Message) -> None:
        for name, value in message.items():
            if name.endswith("_ms") and math.isfinite(value):
                self._curve(f"{where}/{name}", [value])
