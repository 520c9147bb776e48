"""Every message: one declaration from which packing, checking and the reference page follow.

Shape letters: T transitions, B sequences, K sequences told of, O observation size, A action size,
J joints.
"""

from __future__ import annotations

from typing import Any

from gfm.core import (
    Batch,
    Command,
    CommandKind,
    EnvironmentSpec,
    Observation,
    Sequence,
    Status,
    Weights,
)
from gfm_wire.control import (
    Ack,
    ByHand,
    EnvironmentRequest,
    NotReady,
    PlaceObject,
    PowerAction,
    PowerRobot,
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
    ScaleSpeed,
    SequenceAck,
    SetPayload,
    StatusRequest,
    StopRobot,
    WeightsRequest,
)
from gfm_wire.kinds import Array, Choice, Flag, Integer, ListOf, MapOf, Number, Optional, Text
from gfm_wire.schema import Schema
from gfm_wire.tracking import ObjectPose, TrackedObject

Message = (
    Ack
    | Batch
    | ByHand
    | Command
    | EnvironmentRequest
    | EnvironmentSpec
    | NotReady
    | ObjectPose
    | Observation
    | PlaceObject
    | PowerRobot
    | RecordDone
    | RecordStart
    | RecordStop
    | Refusal
    | ReleaseRobot
    | RobotExchange
    | RobotStates
    | RunEnvironment
    | SampleRequest
    | ScaleSpeed
    | Sequence
    | SequenceAck
    | SetPayload
    | Status
    | StatusRequest
    | StopRobot
    | TrackedObject
    | Weights
    | WeightsRequest
)
"""Whatever may cross a process."""

TEXT = Text()
COUNT = Integer(least=0)
STAMP = Integer()

JOINTS = Array("<f8", "J")

SPEC = Schema(
    EnvironmentSpec,
    1,
    {
        "name": TEXT,
        "observation_size": COUNT,
        "action_size": COUNT,
        "privileged_size": COUNT,
        "reward_limit": Number(),
        "observation_limit": Number(),
    },
)
SEQUENCE = Schema(
    Sequence,
    2,
    {
        "actor": TEXT,
        "epoch": COUNT,
        "number": COUNT,
        "weights_life": COUNT,
        "weights_version": COUNT,
        "spec_digest": TEXT,
        "observation": Array("<f4", "T+1 O"),
        "action": Array("<f4", "T A"),
        "reward": Array("<f4", "T"),
        "discount": Array("<f4", "T"),
        "log_prob": Array("<f4", "T"),
    },
)
BATCH = Schema(
    Batch,
    3,
    {
        "spec_digest": TEXT,
        "index": Array("<i8", "B"),
        "probability": Array("<f4", "B"),
        "weights_life": Array("<i8", "B"),
        "weights_version": Array("<i8", "B"),
        "observation": Array("<f4", "B T+1 O"),
        "action": Array("<f4", "B T A"),
        "reward": Array("<f4", "B T"),
        "discount": Array("<f4", "B T"),
        "log_prob": Array("<f4", "B T"),
    },
)
WEIGHTS = Schema(
    Weights,
    2,
    {
        "run": TEXT,
        "life": COUNT,
        "version": COUNT,
        "created_ns": STAMP,
        "spec_digest": TEXT,
        "tensors": MapOf(Array("<f4", None)),
    },
)
COMMAND = Schema(
    Command,
    3,
    {
        "kind": Choice(CommandKind),
        "joint_names": ListOf(TEXT),
        "values": JOINTS,
        "stamp_ns": STAMP,
        "number": COUNT,
        "needs_object": Flag(),
        "speed_share": Number(),
    },
)
#: Of a body: m and quaternion w x y z.
POSE = Array("<f8", "7")
OBSERVATION = Schema(
    Observation,
    5,
    {
        "joint_names": ListOf(TEXT),
        "position": JOINTS,
        "velocity": JOINTS,
        "effort": JOINTS,
        "stamp_ns": STAMP,
        "received_ns": STAMP,
        "applied": Optional(COMMAND),
        "requested": Optional(COMMAND),
        "reason": COUNT,
        "heard_ns": STAMP,
        "decided_ns": STAMP,
        "sent_ns": STAMP,
        "object_position": Optional(Array("<f8", "3")),
        "object_quaternion": Optional(Array("<f8", "4")),
        "object_stamp_ns": STAMP,
    },
)
OBJECT_POSE = Schema(
    ObjectPose,
    1,
    {
        "position": Array("<f8", "3"),
        "quaternion": Array("<f8", "4"),
        "covariance": Array("<f8", "6 6"),
    },
)
TRACKED = Schema(
    TrackedObject,
    1,
    {"stamp_ns": STAMP, "pose": Optional(OBJECT_POSE), "views": MapOf(OBJECT_POSE)},
)
STATUS = Schema(
    Status,
    1,
    {
        "role": TEXT,
        "name": TEXT,
        "pid": COUNT,
        "host": TEXT,
        "counters": MapOf(COUNT),
        "gauges": MapOf(Number()),
        "note": TEXT,
    },
)
SET_PAYLOAD = Schema(SetPayload, 1, {"mass_kg": Number(), "com_m": Array("<f8", "3")})
CONTROL = (
    Schema(Ack, 1, {}),
    Schema(Refusal, 1, {"reason": TEXT}),
    Schema(NotReady, 1, {"reason": TEXT, "inserted": COUNT, "needed": COUNT}),
    Schema(SequenceAck, 2, {"actor": TEXT, "epoch": COUNT, "number": COUNT, "cursor": COUNT}),
    Schema(
        SampleRequest,
        2,
        {
            "batch_size": Integer(least=1),
            "spec_digest": TEXT,
            "seen": Array("<i8", "K"),
            "priority": Array("<f4", "K"),
        },
    ),
    Schema(EnvironmentRequest, 1, {"name": TEXT}),
    Schema(RunEnvironment, 2, {"name": TEXT, "settings": Text(2**20), "spec": SPEC}),
    Schema(WeightsRequest, 3, {"spec_digest": TEXT, "settings": MapOf(TEXT)}),
    Schema(StatusRequest, 1, {}),
    Schema(RecordStart, 1, {"name": TEXT, "metadata": MapOf(TEXT)}),
    Schema(RecordStop, 1, {}),
    Schema(RecordDone, 1, {"path": TEXT, "ticks": COUNT}),
    Schema(PlaceObject, 1, {"pose": POSE}),
    SET_PAYLOAD,
    Schema(ByHand, 1, {}),
    Schema(ReleaseRobot, 1, {}),
    Schema(StopRobot, 1, {"reason": TEXT}),
    Schema(ScaleSpeed, 1, {"scale": Number()}),
    Schema(PowerRobot, 1, {"action": Choice(PowerAction)}),
    Schema(
        RobotExchange,
        6,
        {
            "commands": ListOf(COMMAND),
            "advance_ns": COUNT,
            "object_pose": Optional(POSE),
            "payload": Optional(SET_PAYLOAD),
            "clock": Choice(RobotClock),
        },
    ),
    Schema(RobotStates, 5, {"states": ListOf(OBSERVATION)}),
)
SCHEMAS: tuple[Schema[Any], ...] = (
    SEQUENCE,
    BATCH,
    WEIGHTS,
    COMMAND,
    OBSERVATION,
    OBJECT_POSE,
    TRACKED,
    STATUS,
    SPEC,
    *CONTROL,
)
