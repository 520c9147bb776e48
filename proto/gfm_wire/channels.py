"""Who may speak under which key: one table, of which the reference page and the router are made."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from gfm_wire.sizes import MAX_BYTES, SMALL_BYTES, most_bytes


class Role(StrEnum):
    """What a process is to the others; the common name of its certificate."""

    ROUTER = "router"
    REPLAY = "replay"
    LEARNER = "learner"
    ACTOR = "actor"
    ROBOT = "robot"
    ROBOT_BRIDGE = "robot_bridge"
    TRACKER = "tracker"
    DRIVER = "driver"
    WATCHER = "watcher"
    SUPERVISOR = "supervisor"


WHO = {
    Role.ROUTER: "the router, the only one that others connect to",
    Role.REPLAY: "`gfm-replay`",
    Role.LEARNER: "`gfm-learner`",
    Role.ACTOR: "`gfm-actor`",
    Role.ROBOT: "the simulated robot",
    Role.ROBOT_BRIDGE: "`gfm-robot-bridge`",
    Role.TRACKER: "`gfm track run --send`",
    Role.DRIVER: "`gfm record`, `gfm excite`, `gfm drive`, `gfm robot`",
    Role.WATCHER: "`gfm status`, `gfm top`, `gfm metrics`, `gfm watch`, `gfm robot stop`",
    Role.SUPERVISOR: "`gfm up`",
}

SERVICES = (Role.ACTOR, Role.LEARNER, Role.REPLAY, Role.ROBOT, Role.ROBOT_BRIDGE, Role.ROUTER)
"""Who says how it is under `status/ROLE/NAME`."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One key, what is said under it, and by whom.

    Attributes:
        key: Below `gfm/RUN/`; NAME is any one part, ROLE the role of who answers.
        kind: A question is asked and answered, a broadcast published and heard.
        messages: Each with its answer, in words; broadcasts have none.
        speakers: Who may ask, or publish.
        listeners: Who may answer, or hear.
    """

    key: str
    kind: Literal["question", "broadcast"]
    messages: tuple[tuple[str, str], ...]
    speakers: tuple[Role, ...]
    listeners: tuple[Role, ...]

    def pattern(self, role: Role | None = None) -> str:
        """Returns the key with `*` for NAME, and for ROLE the one given, or `*`."""
        return self.key.replace("ROLE", role or "*").replace("NAME", "*")

    @property
    def most_bytes(self) -> int:
        """The largest body of what is asked or published."""
        return max(most_bytes(message) for message, _ in self.messages)

    @property
    def most_answer_bytes(self) -> int:
        """The largest body of an answer; a refusal is always possible."""
        answers = [one for _, answer in self.messages for one in answer.split(" or ")]
        return max(SMALL_BYTES, *map(most_bytes, answers))


def _question(
    key: str, *messages: tuple[str, str], of: tuple[Role, ...], to: tuple[Role, ...]
) -> Channel:
    return Channel(key=key, kind="question", messages=messages, speakers=of, listeners=to)


def _broadcast(key: str, message: str, *, of: tuple[Role, ...], to: tuple[Role, ...]) -> Channel:
    return Channel(key=key, kind="broadcast", messages=((message, ""),), speakers=of, listeners=to)


_ACTOR, _LEARNER, _REPLAY = (Role.ACTOR,), (Role.LEARNER,), (Role.REPLAY,)
_DRIVER, _BRIDGE, _ROBOT = (Role.DRIVER,), (Role.ROBOT_BRIDGE,), (Role.ROBOT,)
# Whoever may see the robot may stop it: a stop too many harms nobody.
_WHO_SEES = (Role.DRIVER, Role.WATCHER)
_STATUS = ("StatusRequest", "Status")

CHANNELS = (
    _question("replay/insert", ("Sequence", "SequenceAck or NotReady"), of=_ACTOR, to=_REPLAY),
    _question("replay/sample", ("SampleRequest", "Batch or NotReady"), of=_LEARNER, to=_REPLAY),
    _broadcast("weights", "Weights", of=_LEARNER, to=_ACTOR),
    _question("weights/current", ("WeightsRequest", "Weights"), of=_ACTOR, to=_LEARNER),
    _question(
        "run/environment",
        ("EnvironmentRequest", "RunEnvironment"),
        of=(Role.ACTOR, Role.REPLAY),
        to=_LEARNER,
    ),
    _question("robot/command", ("Command", "Observation"), of=_DRIVER, to=_BRIDGE),
    _broadcast("robot/observation", "Observation", of=_BRIDGE, to=_WHO_SEES),
    _question(
        "robot/record", ("RecordStart", "Ack"), ("RecordStop", "RecordDone"), of=_DRIVER, to=_BRIDGE
    ),
    _question("robot/object", ("PlaceObject", "Ack or ByHand"), of=_DRIVER, to=_BRIDGE),
    _question("robot/payload", ("SetPayload", "Ack or ByHand"), of=_DRIVER, to=_BRIDGE),
    _question("robot/tracked", ("TrackedObject", "Ack"), of=(Role.TRACKER,), to=_BRIDGE),
    _question("robot/stop", ("StopRobot", "Ack"), of=_WHO_SEES, to=_BRIDGE),
    _question("robot/speed", ("ScaleSpeed", "Ack"), of=_DRIVER, to=_BRIDGE),
    _question("robot/power", ("PowerRobot", "Ack"), of=_DRIVER, to=_BRIDGE),
    _question("robot/release", ("ReleaseRobot", "Ack"), of=_DRIVER, to=_BRIDGE),
    _question("sawyer/exchange", ("RobotExchange", "RobotStates"), of=_BRIDGE, to=_ROBOT),
    _question("status/ROLE/NAME", _STATUS, of=(Role.WATCHER, Role.SUPERVISOR), to=SERVICES),
    _question("supervisor/NAME", _STATUS, of=(Role.WATCHER,), to=(Role.SUPERVISOR,)),
)


def largest_body(key: str) -> int:
    """Returns how large a body under a key below `gfm/RUN/` may be, whichever way it goes."""
    parts = key.split("/")
    for channel in CHANNELS:
        wanted = channel.pattern().split("/")
        pairs = zip(wanted, parts, strict=False)
        if len(wanted) == len(parts) and all(one in ("*", part) for one, part in pairs):
            return max(channel.most_bytes, channel.most_answer_bytes)
    return MAX_BYTES


@dataclass(frozen=True, kw_only=True)
class Permissions:
    """What one role may do, by keys below `gfm/RUN/` with `*` for any one part.

    Attributes:
        publishes: Broadcasts that it may send.
        hears: Broadcasts that it may receive.
        asks: Questions that it may ask.
        answers: Questions that it may answer.
    """

    publishes: tuple[str, ...]
    hears: tuple[str, ...]
    asks: tuple[str, ...]
    answers: tuple[str, ...]


def permissions(role: Role) -> Permissions:
    """Returns what a role may do; nothing else is allowed."""
    spoken = [channel for channel in CHANNELS if role in channel.speakers]
    heard = [channel for channel in CHANNELS if role in channel.listeners]
    return Permissions(
        publishes=tuple(one.pattern() for one in spoken if one.kind == "broadcast"),
        hears=tuple(one.pattern() for one in heard if one.kind == "broadcast"),
        asks=tuple(one.pattern() for one in spoken if one.kind == "question"),
        answers=tuple(one.pattern(role) for one in heard if one.kind == "question"),
    )
