"""Every message survives the wire; nothing else gets through it."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.core import (
    Batch,
    Command,
    CommandKind,
    EnvironmentSpec,
    Observation,
    Sequence,
    Status,
    Weights,
    WireError,
)
from gfm_wire import (
    CHANNELS,
    SCHEMAS,
    Ack,
    ByHand,
    EnvironmentRequest,
    Message,
    NotReady,
    ObjectPose,
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
    Stamp,
    StatusRequest,
    StopRobot,
    TrackedObject,
    WeightsRequest,
    decode,
    decode_stamped,
    encode,
    largest_body,
)
from gfm_wire.reference import reference_page
from gfm_wire.sizes import LARGE

RNG = np.random.default_rng(0)


def numbers(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape).astype(np.float32)


SEQUENCE = Sequence(
    actor="actor-1",
    epoch=1_700_000_000_000_000_000,
    number=7,
    weights_life=1,
    weights_version=3,
    spec_digest="abc",
    observation=numbers(4, 5),
    action=numbers(3, 2),
    reward=numbers(3),
    discount=np.ones(3, np.float32),
    log_prob=numbers(3),
)
COMMAND = Command(
    kind=CommandKind.VELOCITY,
    joint_names=("right_j0", "right_j1"),
    values=np.array([0.1, -0.2]),
    stamp_ns=-5,
    number=9,
    needs_object=True,
    speed_share=0.05,
)
POSE = ObjectPose(
    position=np.zeros(3), quaternion=np.array([1.0, 0.0, 0.0, 0.0]), covariance=np.eye(6)
)
OBSERVATION = Observation(
    joint_names=("right_j0", "right_j1"),
    position=np.array([1.0, 2.0]),
    velocity=np.array([3.0, 4.0]),
    effort=np.array([5.0, 6.0]),
    stamp_ns=10,
    received_ns=11,
    applied=COMMAND,
    requested=replace(COMMAND, values=np.array([7.0, 8.0])),
    reason=3,
    heard_ns=8,
    decided_ns=9,
    sent_ns=10,
    object_position=np.zeros(3),
    object_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    object_stamp_ns=7,
)
EXAMPLES: tuple[Message, ...] = (
    SEQUENCE,
    Batch(
        spec_digest="abc",
        index=np.array([1, 2**62]),
        probability=numbers(2),
        weights_life=np.ones(2, np.int64),
        weights_version=np.array([1, 2**62]),
        observation=numbers(2, 4, 5),
        action=numbers(2, 3, 2),
        reward=numbers(2, 3),
        discount=numbers(2, 3),
        log_prob=numbers(2, 3),
    ),
    Weights(
        run="r",
        life=5,
        version=3,
        created_ns=12,
        spec_digest="abc",
        tensors={"w": numbers(3, 2), "b": numbers(2), "scale": np.float32(2.0)},
    ),
    COMMAND,
    OBSERVATION,
    replace(
        OBSERVATION, applied=None, requested=None, object_position=None, object_quaternion=None
    ),
    Status(
        role="actor",
        name="a",
        pid=1,
        host="h",
        counters={"env_steps": 3},
        gauges={"weights_age_s": float("inf")},
        note="résumé",
    ),
    Ack(),
    Refusal(reason="no"),
    NotReady(reason="waiting", inserted=1, needed=2),
    SequenceAck(actor="a", epoch=1, number=1, cursor=2),
    SampleRequest(batch_size=32, spec_digest="abc"),
    SampleRequest(batch_size=1, seen=np.array([3, 2**62]), priority=numbers(2)),
    WeightsRequest(spec_digest="abc", settings={"horizon": "10"}),
    EnvironmentRequest(name="gfm_fit"),
    EnvironmentSpec(name="gfm_fit", observation_size=3, action_size=2, reward_limit=1.0),
    RunEnvironment(
        name="gfm_fit",
        settings='{"horizon":20}',
        spec=EnvironmentSpec(name="gfm_fit", observation_size=3, action_size=2),
    ),
    StatusRequest(),
    RecordStart(name="training", metadata={"mode": "velocity"}),
    RecordStop(),
    RecordDone(path="a/b.mcap", ticks=100),
    PlaceObject(pose=np.arange(7.0)),
    SetPayload(mass_kg=0.6, com_m=np.arange(3.0)),
    POSE,
    TrackedObject(stamp_ns=3, pose=POSE, views={"left": POSE}),
    TrackedObject(stamp_ns=3),
    ByHand(),
    ReleaseRobot(),
    StopRobot(reason="it smells"),
    ScaleSpeed(scale=0.5),
    PowerRobot(action=PowerAction.RESET),
    RobotExchange(commands=(COMMAND, COMMAND), advance_ns=10**7, object_pose=np.arange(7.0)),
    RobotExchange(commands=(), advance_ns=0, clock=RobotClock.LOCKSTEP),
    RobotExchange(commands=(), advance_ns=0, payload=SetPayload(mass_kg=0.0, com_m=np.zeros(3))),
    RobotStates(states=(OBSERVATION, OBSERVATION)),
)


def assert_same(got: object, expected: object) -> None:
    if isinstance(expected, np.ndarray | np.generic):
        assert isinstance(got, np.ndarray)
        assert got.dtype == expected.dtype
        np.testing.assert_array_equal(got, expected, strict=True)
        assert got.flags.writeable
    elif hasattr(expected, "__dataclass_fields__"):
        assert type(got) is type(expected)
        for field in fields(expected):
            assert_same(getattr(got, field.name), getattr(expected, field.name))
    elif isinstance(expected, dict):
        assert got.keys() == expected.keys()
        for key, item in expected.items():
            assert_same(got[key], item)
    elif isinstance(expected, tuple):
        assert isinstance(got, tuple)
        for one, other in zip(got, expected, strict=True):
            assert_same(one, other)
    else:
        both_nan = got != got and expected != expected
        assert got == expected or both_nan
        assert type(got) is type(expected)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: type(message).__name__)
def test_decode_undoes_encode(message):
    stamp = Stamp(sender="s", epoch=5, number=6)
    decoded, decoded_stamp = decode_stamped(encode(message, stamp))
    assert_same(decoded, message)
    assert decoded_stamp == stamp


def test_every_schema_has_an_example_here():
    assert {type(message) for message in EXAMPLES} == {schema.value_type for schema in SCHEMAS}


def test_arrays_are_converted_to_the_declared_type_and_order():
    transposed = np.asfortranarray(np.arange(20.0).reshape(4, 5))
    decoded = decode(encode(replace(SEQUENCE, observation=transposed)))
    np.testing.assert_array_equal(decoded.observation, transposed.astype(np.float32), strict=True)


def damaged(message: Message, *path: object, to: object) -> bytes:
    """Returns the body of a message with one place of its map changed, or removed by `...`."""
    envelope = msgpack.unpackb(encode(message))
    place = envelope
    for step in path[:-1]:
        place = place[step]
    if to is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return msgpack.packb(envelope)


NAN = np.array([0.0, np.nan, 0.0], "<f4").tobytes()
INF = np.array([0.0, np.inf], "<f8").tobytes()
BAD_BODIES = {
    "not_msgpack: Unpack failed": encode(SEQUENCE)[:-1],
    "not_msgpack: unpack": b"\x01\x02",
    "not_msgpack: 4294967295 exceeds max_array_len": b"\xdd\xff\xff\xff\xff",
    "too_deep: the body is nested too deeply": b"\x91" * 5000 + b"\x01",
    "type: the body is int, expected a map": msgpack.packb(1),
    "fields: the envelope lacks epoch": damaged(Ack(), "epoch", to=...),
    "fields: the envelope has unknown fields pickle": damaged(Ack(), "pickle", to=b""),
    "range: number is -1": damaged(Ack(), "number", to=-1),
    "schema: 'Pickle' is not one of Sequence, Batch": damaged(Ack(), "schema", to="Pickle"),
    "schema: ": damaged(Ack(), "schema", to=["a"]),
    "version: Ack is of version 2, expected 1": damaged(Ack(), "version", to=2),
    "version: Ack is of version True": damaged(Ack(), "version", to=True),
    "type: Ack is list, expected a map": damaged(Ack(), "body", to=[]),
    "fields: Ack has unknown fields a": damaged(Ack(), "body", "a", to=1),
    "fields: Sequence lacks reward": damaged(SEQUENCE, "body", "reward", to=...),
    "type: Sequence.actor is int, expected text": damaged(SEQUENCE, "body", "actor", to=1),
    "range: Sequence.actor has 5000 char": damaged(SEQUENCE, "body", "actor", to="a" * 5000),
    "type: Sequence.epoch is bool": damaged(SEQUENCE, "body", "epoch", to=True),
    "range: Sequence.epoch is 18446744073709551615": damaged(
        SEQUENCE, "body", "epoch", to=2**64 - 1
    ),
    "type: Sequence.reward is list, expected an array": damaged(
        SEQUENCE, "body", "reward", to=[1.0]
    ),
    "dtype: Sequence.reward has dtype '|O8', expected '<f4'": damaged(
        SEQUENCE, "body", "reward", "dtype", to="|O8"
    ),
    "type: Sequence.reward.shape is int": damaged(SEQUENCE, "body", "reward", "shape", to=3),
    "shape: Sequence.reward has shape [1, 3], expected (T,)": damaged(
        SEQUENCE, "body", "reward", "shape", to=[1, 3]
    ),
    "shape: Sequence.reward has shape [-3]": damaged(SEQUENCE, "body", "reward", "shape", to=[-3]),
    "shape: Sequence.reward of shape (4,) has 12 bytes, expected 16": damaged(
        SEQUENCE, "body", "reward", "shape", to=[4]
    ),
    "shape: Weights.tensors['b'] has shape (0, 9223372036854775807, 9": damaged(
        EXAMPLES[2],
        "body",
        "tensors",
        "b",
        to={"dtype": "<f4", "shape": [0, 2**63 - 1, 2**63 - 1], "data": b""},
    ),
    "shape: Sequence: discount has shape (2,), expected (3,)": damaged(
        SEQUENCE, "body", "discount", to={"dtype": "<f4", "shape": [2], "data": bytes(8)}
    ),
    "type: Sequence.reward.data is str": damaged(SEQUENCE, "body", "reward", "data", to="abcd"),
    "not_finite: Sequence.reward holds NaN": damaged(SEQUENCE, "body", "reward", "data", to=NAN),
    "not_finite: Command.values holds": damaged(COMMAND, "body", "values", "data", to=INF),
    "range: Command.kind is 'push', expected": damaged(COMMAND, "body", "kind", to="push"),
    "type: Command.joint_names is str": damaged(COMMAND, "body", "joint_names", to="ab"),
    "type: Command.joint_names[1] is int": damaged(COMMAND, "body", "joint_names", 1, to=2),
    "shape: Command: values has shape (2,), expected (1,)": damaged(
        COMMAND, "body", "joint_names", to=["a"]
    ),
    "type: RobotStates.states[1].applied.kind is NoneType": damaged(
        EXAMPLES[-1], "body", "states", 1, "applied", "kind", to=None
    ),
    "range: SampleRequest.batch_size is 0": damaged(
        SampleRequest(batch_size=1), "body", "batch_size", to=0
    ),
    "type: Status.gauges['weights_age_s'] is str": damaged(
        EXAMPLES[6], "body", "gauges", "weights_age_s", to="1"
    ),
}


@pytest.mark.parametrize("message", BAD_BODIES)
def test_a_bad_body_is_refused_with_what_was_got_and_what_was_expected(message):
    with pytest.raises(WireError) as caught:
        decode(BAD_BODIES[message])
    assert str(caught.value).startswith(message)
    assert caught.value.reason == message.partition(":")[0]
    assert len(str(caught.value)) < 400


def test_a_body_that_is_too_large_is_neither_sent_nor_read():
    body = encode(SEQUENCE)
    with pytest.raises(WireError, match=f"too_large: {len(body)} bytes, limit 100"):
        encode(SEQUENCE, max_bytes=100)
    with pytest.raises(WireError, match=f"too_large: {len(body)} bytes, limit 100"):
        decode(body, max_bytes=100)
    decode(body, max_bytes=len(body))


def test_a_body_is_no_larger_than_its_kind_of_message_may_be():
    long = Refusal(reason="x" * 4096)
    many = {f"{n:04000d}": 1 for n in range(70)}
    status = Status(role="a", name="b", pid=1, host="c", counters=many)
    decode(encode(long))
    with pytest.raises(WireError, match=r"too_large: \d+ bytes, limit 262144"):
        encode(status)
    envelope = msgpack.unpackb(encode(replace(status, counters={})))
    envelope["body"]["counters"] = many
    with pytest.raises(WireError, match=r"too_large: \d+ bytes, limit 262144"):
        decode(msgpack.packb(envelope))


@pytest.mark.parametrize(
    ("key", "mib"),
    [
        ("replay/insert", 16),
        ("replay/sample", 64),
        ("weights", 64),
        ("weights/current", 64),
        ("sawyer/exchange", 4),
        ("robot/command", 0.25),
        ("status/actor/actor-1", 0.25),
        ("supervisor/actor-1", 0.25),
        ("status/actor/actor-1/more", 64),
        ("something/else", 64),
    ],
)
def test_what_is_said_under_a_key_bounds_its_bodies(key, mib):
    assert largest_body(key) == mib * 2**20


def test_every_limit_is_that_of_a_message_there_is():
    assert LARGE.keys() <= {schema.name for schema in SCHEMAS}
    said = {
        one for c in CHANNELS for pair in c.messages for text in pair for one in text.split(" or ")
    }
    assert said - {""} <= {schema.name for schema in SCHEMAS}


def test_a_list_that_claims_more_items_than_allowed_reserves_no_memory():
    nested = b"\xdc\xff\xff" * 500
    with pytest.raises(WireError, match="not_msgpack: 65535 exceeds max_array_len"):
        decode(nested)


def test_what_is_no_message_cannot_be_encoded():
    with pytest.raises(TypeError, match="dict is no message"):
        encode({"a": 1})


def decodes_or_is_refused(body: bytes) -> None:
    try:
        message = decode(body)
    except WireError:
        return
    assert_same(decode(encode(message)), message)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=300))
def test_random_bytes_are_decoded_or_refused(body):
    decodes_or_is_refused(body)


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(EXAMPLES),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1),
)
def test_flipped_bytes_are_decoded_or_refused(message, changes):
    body = bytearray(encode(message))
    for where, value in changes:
        body[int(where * len(body))] = value
    decodes_or_is_refused(bytes(body))


JSON_LIKE = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=16),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(EXAMPLES), st.data())
def test_replaced_values_are_decoded_or_refused(message, data):
    envelope = msgpack.unpackb(encode(message))
    place = envelope
    while True:
        key = data.draw(st.sampled_from(sorted(place)))
        if not (isinstance(place[key], dict) and place[key] and data.draw(st.booleans())):
            break
        place = place[key]
    place[key] = data.draw(JSON_LIKE)
    decodes_or_is_refused(msgpack.packb(envelope))


def test_every_field_of_every_message_is_documented():
    for schema in SCHEMAS:
        texts = schema.documentation
        assert {name for name in schema.kinds if texts.get(name)} == set(schema.kinds), schema.name


def test_the_reference_page_is_current():
    page = Path(__file__).parents[2] / "docs" / "wire.md"
    assert page.read_text(encoding="utf-8") == reference_page(), (
        "run: python -m gfm_wire > docs/wire.md"
    )
