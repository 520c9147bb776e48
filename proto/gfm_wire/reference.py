"""The reference page of the wire format, written from the declarations of the messages."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from typing import Any

from gfm_wire.codec import MAX_BYTES, MAX_ITEMS
from gfm_wire.kinds import DTYPES, Reason
from gfm_wire.schema import Schema
from gfm_wire.schemas import SCHEMAS

_KEYS = (
    ("replay/insert", "question", "Sequence", "SequenceAck or NotReady", "actors ask replay"),
    ("replay/sample", "question", "SampleRequest", "Batch or NotReady", "the learner asks replay"),
    ("weights", "broadcast", "Weights", "", "the learner, after an update"),
    ("weights/current", "question", "WeightsRequest", "Weights", "late joiners ask the learner"),
    (
        "run/environment",
        "question",
        "EnvironmentRequest",
        "RunEnvironment",
        "actors and replay ask",
    ),
    ("robot/command", "question", "Command", "Observation", "a policy asks the robot bridge"),
    ("robot/observation", "broadcast", "Observation", "", "the robot bridge, each tick"),
    ("robot/record", "question", "RecordStart", "Ack", "whoever records asks the bridge"),
    ("robot/record", "question", "RecordStop", "RecordDone", "whoever records asks the bridge"),
    ("robot/object", "question", "PlaceObject", "Ack or ByHand", "driver to robot bridge"),
    ("robot/stop", "question", "StopRobot", "Ack", "whoever sees that the robot must stop"),
    ("robot/speed", "question", "ScaleSpeed", "Ack", "whoever wants it slower, or at rest"),
    ("robot/power", "question", "PowerRobot", "Ack", "a person switches the robot's drives"),
    ("robot/release", "question", "ReleaseRobot", "Ack", "the driver lets go of the robot"),
    ("sawyer/exchange", "question", "RobotExchange", "RobotStates", "bridge to simulated robot"),
    ("status/ROLE/NAME", "question", "StatusRequest", "Status", "every service answers"),
    ("supervisor/NAME", "question", "StatusRequest", "Status", "`gfm up`, of a process it keeps"),
)

_INTRODUCTION = f"""\
# The wire

Written by `python -m gfm_wire` from the declarations in `proto/gfm_wire/schemas.py`; a test fails
where this page is not current.

Processes talk over [zenoh](https://zenoh.io): one router, every other process a client of it. Keys
begin with `gfm/RUN/`, so that runs may share a router. There are two ways to talk: a *question* is
a zenoh query whose payload is one message, answered by one message, by a `Refusal`, or not at all
(which the asker notices); a *broadcast* is a put whose receivers keep the newest.

## Bodies

Every payload is one msgpack map:

| key | type | meaning |
|---|---|---|
| `schema` | text | the message's name, below |
| `version` | integer | the schema's version; another one than the reader's is refused |
| `sender` | text | name of the sending connection |
| `epoch` | integer ≥ 0 | when that connection began, UTC ns: tells lives of one name apart |
| `number` | integer ≥ 0 | counts the sender's messages under one key from 0: gaps show |
| `body` | map | the fields of the message, exactly those below |

An array is a map {{`dtype`, `shape`, `data`}}: one of {", ".join(f'`"{d}"`' for d in DTYPES)}
(little-endian), the sizes of its dimensions, and its bytes in C order. Its numbers must be finite.
Nothing is pickled; there are no msgpack extension types. A body may have {MAX_BYTES // 2**20} MiB,
a list or map {MAX_ITEMS} items, a text 4096 characters.

## Refusals

A body that is not exactly as declared is refused: it is counted under one of these words in
`rejected_WORD` and `rejected_messages` of the receiver's status, and a question is answered by a
`Refusal` that names the field, what it was, and what was expected.
"""

_REASONS = {
    Reason.NOT_MSGPACK: "bytes that are not one msgpack value, or one with too long a list or map",
    Reason.TOO_LARGE: "more bytes than allowed",
    Reason.TOO_DEEP: "nested more deeply than any message",
    Reason.SCHEMA: "no message of this name",
    Reason.VERSION: "another version of the schema",
    Reason.FIELDS: "fields are missing, or there are unknown ones",
    Reason.TYPE: "a field of another type",
    Reason.RANGE: "a number, word or text outside of what is allowed",
    Reason.DTYPE: "an array of another element type",
    Reason.SHAPE: "an array of another shape, or one that contradicts the other fields",
    Reason.NOT_FINITE: "an array with NaN or infinity",
}


_BELIEVED = """\
## What is believed

A body as declared may still say what cannot be. Each receiver checks what would harm it, counts
what it refuses as `refused_WORD`, `refused_from_SENDER` and in `rejected_messages`, and goes on.
"""

_CHECKS = (
    (
        "Sequence",
        "replay",
        "is of another environment than the learner names under `run/environment`; holds values "
        "outside of the ranges of its `EnvironmentSpec`; is of an actor whose name is none",
    ),
    (
        "SampleRequest",
        "replay",
        "asks for more sequences than `max_batch_size`, than are kept, or than a message holds",
    ),
    (
        "SequenceAck",
        "actor",
        "is of another actor, epoch or number than was sent, or has a cursor beyond what was",
    ),
    (
        "Batch",
        "learner",
        "has another digest, size or shape than was asked for, or values outside of the ranges",
    ),
    (
        "Weights",
        "actor",
        "are of another run or environment; act without sense on a fixed probe (not finite, or far "
        "outside); are of an older life than the one that is followed",
    ),
)

_IDENTITY = """\
**Weights** are identified by run, life, version and architecture. A learner begins a new life
whenever it is started, ordered after that of the checkpoint it goes on from; within a life versions
never go backwards. A broadcast is believed where it continues what the learner itself answered:
same connection, life and architecture, a version that is not smaller and at most a million ahead.
About everything else `weights/current` is asked, and the answer counts.

**Sequences** are numbered within a life of their actor: its name and an epoch. Epochs are names,
not times: none ends another, so that clocks may be set back. A sequence that is sent again counts
once, also after a restart of a replay service that keeps its sequences in a folder. `NotReady` as
the answer to a sequence asks to send it again later: the disk is full. All who serve
`replay/insert` are asked: a second service takes nothing away from the first, and shows in
`replays_changed` of the actors.

None of this is authentication: `sender` is what a sender says of itself, and whoever serves
`weights/current` can be the learner. Keep strangers off the network.
"""


def reference_page() -> str:
    """Returns docs/wire.md."""
    reasons = _table(("word", "what was wrong"), [(f"`{r}`", _REASONS[r]) for r in Reason])
    keys = _table(
        ("key", "kind", "message", "answer", "who"), [(f"`{key}`", *rest) for key, *rest in _KEYS]
    )
    checks = _table(("message", "who checks", "not taken where it"), _CHECKS)
    messages = "\n".join(_message(schema) for schema in SCHEMAS)
    return (
        f"{_INTRODUCTION}\n{reasons}\n{_BELIEVED}\n{checks}\n{_IDENTITY}\n"
        f"## Keys\n\n{keys}\n## Messages\n\n"
        "Shape letters: T transitions, B sequences, O observation size, A action size, J joints.\n"
        f"\n{messages}"
    )


def _message(schema: Schema[Any]) -> str:
    summary, _, rest = (inspect.getdoc(schema.value_type) or "").partition("\n")
    notes, _, _ = rest.partition("Attributes:")
    paragraphs = "\n\n".join(text.strip() for text in (summary, notes) if text.strip())
    texts = schema.documentation
    rows = [
        (f"`{name}`", kind.describe(), _without_shape(texts[name]))
        for name, kind in schema.kinds.items()
    ]
    table = _table(("field", "type", "meaning"), rows) if rows else "No fields.\n"
    return f"### {schema.name}, version {schema.version}\n\n{paragraphs}\n\n{table}"


def _without_shape(text: str) -> str:
    """Returns a field's text without its shape, which stands in the type column."""
    return re.sub(r",? ?shape \([^)]*\)", "", text).removeprefix(".")


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
