"""What the router lets through, made of the one table of who may speak."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from gfm_wire import CHANNELS, Role, permissions

_ANY_RUN = "gfm/*"


def access_control() -> dict[str, object]:
    """Returns the `access_control` section of a router's configuration.

    Whoever has no certificate of a role, and every message that no rule names, is denied. The
    router's own role has no rules: it connects to nobody.
    """
    rules = {role: list(_rules(role)) for role in Role if role is not Role.ROUTER}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(chain.from_iterable(rules.values())),
        "subjects": [{"id": role, "cert_common_names": [role]} for role in rules],
        "policies": [
            {"id": role, "rules": [rule["id"] for rule in rules[role]], "subjects": [role]}
            for role in rules
        ],
    }


def size_limits() -> list[dict[str, object]]:
    """Returns the `low_pass_filter` section: what is larger than any message of its key is dropped.

    A receiver's queue is bounded in its number of messages; this bounds their sizes.
    """
    return [
        {
            "id": f"{number}-{word}",
            "flows": ["ingress"],
            "messages": [word],
            "key_exprs": [f"{_ANY_RUN}/{channel.pattern()}"],
            "size_limit": limit,
        }
        for number, channel in enumerate(CHANNELS)
        for word, limit in (
            ("put" if channel.kind == "broadcast" else "query", channel.most_bytes),
            ("reply", channel.most_answer_bytes),
        )
    ]


def _rules(role: Role) -> Iterator[dict[str, object]]:
    """Yields one rule per thing that a role does, and direction: a rule allows a product.

    Ingress is what the router takes of a client, egress what it hands to it. Declarations of the
    other side are handed on, so that a client knows whether there is anybody to send to.
    """
    may = permissions(role)
    # A survey asks everybody by one key with wildcards, and is handed on under that.
    asked = [one.pattern() for one in CHANNELS if one.pattern(role) in may.answers]
    for name, flow, messages, keys in (
        ("publishes", "ingress", ["put"], may.publishes),
        ("is-heard", "egress", ["declare_subscriber"], may.publishes),
        ("hears", "ingress", ["declare_subscriber"], may.hears),
        ("is-told", "egress", ["put"], may.hears),
        ("asks", "ingress", ["query"], may.asks),
        ("is-answered", "egress", ["declare_queryable", "reply"], may.asks),
        ("answers", "ingress", ["declare_queryable", "reply"], may.answers),
        ("is-asked", "egress", ["query"], asked),
    ):
        if keys:
            yield {
                "id": f"{role}-{name}",
                "permission": "allow",
                "flows": [flow],
                "messages": messages,
                "key_exprs": [f"{_ANY_RUN}/{key}" for key in keys],
            }
