"""The reference page of the wire format, written from the declarations of the messages."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from typing import Any

from gfm_wire.channels import CHANNELS, WHO, Channel, Role, permissions
from gfm_wire.codec import MAX_ITEMS
from gfm_wire.kinds import DTYPES, Reason
from gfm_wire.schema import Schema
from gfm_wire.schemas import SCHEMAS
from gfm_wire.sizes import LARGE, SMALL_BYTES

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
Nothing is pickled; there are no msgpack extension types. A list or map may have {MAX_ITEMS} items,
a text 4096 characters, a body {SMALL_BYTES // 2**10} KiB, except of
{", ".join(f"{name} ({size // 2**20} MiB)" for name, size in LARGE.items())}.
What is larger than any message of its key the router does not pass on, and no receiver reads.

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
        "asks for more sequences than `max_batch_size`, than are kept, or than a message holds; "
        "tells of more than that, or of priorities that are none",
    ),
    (
        "SequenceAck",
        "actor",
        "is of another actor, epoch or number than was sent, or has a cursor beyond what was",
    ),
    (
        "Batch",
        "learner",
        "has another digest, size or shape than was asked for, or values outside of the ranges, "
        "probabilities included",
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
the answer to a sequence asks to send it again later: the disk is full, or the learner has to catch
up first (`min_samples_per_insert`). All who serve `replay/insert` are asked:
a second service takes nothing away from the first, and shows in `replays_changed` of the actors.

None of this is authentication: `sender` is what a sender says of itself. Who may send at all is
another matter ([below](#who-may-speak)).
"""

_WHO_MAY_SPEAK = """\
## Who may speak

Without certificates whoever reaches the router may say and hear everything, other users of the
machine included: a router that has none must be told so (`--insecure`), wherever it listens.
`gfm up` and `gfm router` make some in `runs/certs`, and the systems of `gfm run`, `gfm fit`,
`gfm train`, `gfm drive` and `gfm transfer` in `certs` of their own folders. A bridge to a real
robot does not begin without.

With certificates (`gfm certs --out DIR`, then `--certs DIR` for every process;
[containers.md](containers.md#certificates)) every connection is encrypted, both sides prove who
they are, and the router lets each say and hear what the table of [keys](#keys) allows its role, in
every run. It drops all else. The router's rules are made of that table, which by role is:
"""

_WHAT_IT_IS_WORTH = """\
- A role is the common name of a certificate. Processes of one role are not told apart: `sender`,
  the actor of a sequence and the NAME in a key remain what a process says of itself, also in
  `refused_from_SENDER`. What a receiver knows is the role: no other could have asked under that
  key.
- zenoh hands a message to its receiver with nothing about the sender that the sender could not
  choose. The certificate is known to the router alone, which counts its connections by role
  (`connected_ROLE` in its status).
- What is dropped is dropped in silence: a broadcast does not arrive, a question finds nobody who
  answers. The router's `dropped_messages` counts all of it together. `rejected_` and `refused_`
  count what came through.
- Whoever sends much waits behind itself: replay and learner read the questions of each sender into
  a line of its own, bounded (beyond it `refused_queue`), and answer the front of each line in turn.
  Who asks more often than allowed is told to come later (`refused_rate`; `most_per_s` of replay,
  20 a second at the learner). Who goes by many names has as many turns, and who sends more than a
  receiver can read drowns out others that have the same role.
- The router reads everything, and whoever has the authority's key can be anybody.
"""


def reference_page() -> str:
    """Returns docs/wire.md."""
    reasons = _table(("word", "what was wrong"), [(f"`{r}`", _REASONS[r]) for r in Reason])
    keys = _table(
        ("key", "kind", "message", "answer", "asked or published by", "answered or heard by"),
        [row for channel in CHANNELS for row in _channel(channel)],
    )
    roles = _table(
        ("role", "who that is", "publishes", "hears", "asks", "answers"),
        [_role(role) for role in Role],
    )
    checks = _table(("message", "who checks", "not taken where it"), _CHECKS)
    messages = "\n".join(_message(schema) for schema in SCHEMAS)
    return (
        f"{_INTRODUCTION}\n{reasons}\n{_BELIEVED}\n{checks}\n{_IDENTITY}\n"
        f"{_WHO_MAY_SPEAK}\n{roles}\n{_WHAT_IT_IS_WORTH}\n"
        f"## Keys\n\n{keys}\n## Messages\n\n"
        "Shape letters: T transitions, B sequences, K sequences told of, O observation size, A "
        "action size, J joints.\n"
        f"\n{messages}"
    )


def _channel(channel: Channel) -> list[tuple[str, ...]]:
    """Returns a row for each message of a key."""
    roles = (", ".join(sorted(channel.speakers)), ", ".join(sorted(channel.listeners)))
    return [(f"`{channel.key}`", channel.kind, *pair, *roles) for pair in channel.messages]


def _role(role: Role) -> tuple[str, ...]:
    """Returns the row of a role."""
    may = permissions(role)
    lists = (may.publishes, may.hears, may.asks, may.answers)
    return (role, WHO[role], *(", ".join(f"`{key}`" for key in keys) for keys in lists))


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
