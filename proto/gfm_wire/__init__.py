"""The messages between processes: name, version, fields, units; msgpack encode and decode."""

from gfm_wire.codec import MAX_BYTES, Stamp, decode, decode_stamped, encode
from gfm_wire.control import (
    Ack,
    ByHand,
    EnvironmentRequest,
    NotReady,
    PlaceObject,
    RecordDone,
    RecordStart,
    RecordStop,
    Refusal,
    ReleaseRobot,
    RobotClock,
    RobotExchange,
    RobotStates,
    RunEnvironment,
    SampleRequest,
    SequenceAck,
    StatusRequest,
    WeightsRequest,
)
from gfm_wire.kinds import Reason
from gfm_wire.schemas import SCHEMAS, Message

__all__ = [
    "MAX_BYTES",
    "SCHEMAS",
    "Ack",
    "ByHand",
    "EnvironmentRequest",
    "Message",
    "NotReady",
    "PlaceObject",
    "Reason",
    "RecordDone",
    "RecordStart",
    "RecordStop",
    "Refusal",
    "ReleaseRobot",
    "RobotClock",
    "RobotExchange",
    "RobotStates",
    "RunEnvironment",
    "SampleRequest",
    "SequenceAck",
    "Stamp",
    "StatusRequest",
    "WeightsRequest",
    "decode",
    "decode_stamped",
    "encode",
]
