"""A real router, and sessions of every role: what the table of keys allows, and nothing else."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import pytest
import zenoh

from certificates import certificates
from gfm.core import BadInputError, UnreachableError
from gfm.launch import RunAddress, free_endpoint
from gfm.transport import PendingReply, Server, Transport, ZenohTransport, read_credentials
from gfm_wire import CHANNELS, RecordDone, Role, StatusRequest

CLIENTS = [role for role in Role if role is not Role.ROUTER]
QUESTIONS = [channel for channel in CHANNELS if channel.kind == "question"]
BROADCASTS = [channel for channel in CHANNELS if channel.kind == "broadcast"]


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return certificates(tmp_path_factory.mktemp("certs"))


@pytest.fixture(scope="module")
def address(certs) -> Iterator[RunAddress]:
    """Yields where a router lets nobody in but who has a certificate."""
    at = RunAddress(run="test", endpoint=free_endpoint(secure=True), certs=str(certs))
    credentials = read_credentials(certs, Role.ROUTER)
    with ZenohTransport.open(run="test", listen=[at.endpoint], credentials=credentials):
        yield at


Open = Callable[[Role], Transport]


@pytest.fixture
def join(address) -> Iterator[Open]:
    """Yields a function that opens one more connection of a role."""
    opened: list[Transport] = []

    def joining(role: Role) -> Transport:
        opened.append(address.open(role, name=role))
        return opened[-1]

    yield joining
    for transport in opened:
        transport.close()


def eventually(poll: Callable[[], object]) -> object:
    """Returns the first true thing that `poll` returns; fails after ten seconds."""
    deadline_s = time.monotonic() + 10.0
    while not (value := poll()):
        assert time.monotonic() < deadline_s, "it never happened"
        time.sleep(0.001)
    return value


def answerers(pending: PendingReply, servers: dict[Role, Server]) -> set[str]:
    """Returns who answers a question, all of whom name their role."""
    heard: set[str] = set()
    deadline_s = time.monotonic() + 5.0
    while time.monotonic() < deadline_s:
        for role, server in servers.items():
            if (request := server.receive()) is not None:
                request.reply(RecordDone(path=role, ticks=1))
        try:
            if (answer := pending.poll()) is not None:
                heard.add(answer.path)
                pending.reject()
        except UnreachableError:
            return heard
    raise AssertionError("a question without an end")


def keys_of(channel) -> list[tuple[str, set[Role]]]:
    """Returns the keys of a channel, and for each who may answer or hear."""
    if "ROLE" not in channel.key:
        return [(channel.key.replace("NAME", "x"), set(channel.listeners))]
    return [(channel.pattern(role).replace("*", "x"), {role}) for role in channel.listeners]


@pytest.mark.parametrize("channel", QUESTIONS, ids=lambda channel: channel.key)
def test_a_question_is_asked_and_answered_by_those_whom_the_table_names(channel, join):
    serving = {role: join(role) for role in CLIENTS}
    asking = {role: join(role) for role in CLIENTS}
    for key, expected in keys_of(channel):
        allowed = expected - {Role.ROUTER}
        servers = {role: transport.serve(key) for role, transport in serving.items()}

        def asked(role: Role, key: str = key, servers=servers) -> set[str]:
            pending = asking[role].request(key, StatusRequest(), timeout_s=4.0, everybody=True)
            return answerers(pending, servers)

        for role in channel.speakers if allowed else ():
            assert eventually(lambda role=role: asked(role)) == allowed, (key, role)
        for role in set(CLIENTS) - set(channel.speakers):
            assert asked(role) == set(), (key, role)


@pytest.mark.parametrize("channel", BROADCASTS, ids=lambda channel: channel.key)
def test_a_broadcast_is_sent_and_heard_by_those_whom_the_table_names(channel, join):
    hearing = {role: join(role).subscribe(channel.key, keep=100) for role in CLIENTS}
    sending = {role: join(role) for role in CLIENTS}
    heard: dict[Role, set[str]] = {role: set() for role in CLIENTS}

    def all_who_may_have_heard() -> bool:
        for role in (*sorted(set(CLIENTS) - set(channel.speakers)), *channel.speakers):
            sending[role].publish(channel.key, RecordDone(path=role, ticks=1))
        time.sleep(0.02)
        for role, subscription in hearing.items():
            while (message := subscription.take()) is not None:
                heard[role].add(message.path)
        return all(heard[role] for role in channel.listeners)

    eventually(all_who_may_have_heard)
    all_who_may_have_heard()
    for role in CLIENTS:
        assert heard[role] == (set(channel.speakers) if role in channel.listeners else set()), role


def test_a_survey_hears_every_service_under_its_own_role_alone(join):
    watcher, other = join(Role.WATCHER), join(Role.LEARNER)
    own = {role: join(role) for role in (Role.ACTOR, Role.REPLAY)}
    servers = {role: transport.serve(f"status/{role}/x") for role, transport in own.items()}
    # Also who is asked because of one key answers under no other.
    forged = {role: transport.serve("status/learner/x") for role, transport in own.items()}

    def surveyed() -> set[str]:
        pending = watcher.request("status/*/*", StatusRequest(), timeout_s=4.0, everybody=True)
        return answerers(pending, servers | {f"forged-{r}": s for r, s in forged.items()})

    eventually(lambda: surveyed() == {Role.ACTOR, Role.REPLAY})
    pending = other.request("status/*/*", StatusRequest(), timeout_s=4.0, everybody=True)
    assert answerers(pending, servers) == set()


def raw_session(address: RunAddress, mode: str = "client", **tls: object) -> zenoh.Session:
    """Returns a session of somebody who has only zenoh, with the router."""
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "connect/endpoints": [tls.pop("endpoint", address.router)],
        "transport/link/tls": tls,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def shown(folder: Path) -> dict[str, object]:
    """Returns zenoh's settings of who shows the certificate of a folder."""
    return {
        "root_ca_certificate": str(folder / "authority.pem"),
        "connect_certificate": str(folder / "certificate.pem"),
        "connect_private_key": str(folder / "key.pem"),
        "enable_mtls": True,
    }


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_a_watcher_who_uses_zenoh_in_any_other_way_may_no_more(mode, address, certs, join):
    learner, asker, replay = join(Role.LEARNER), join(Role.ACTOR), join(Role.REPLAY)
    heard = asker.subscribe("weights", keep=100)
    servers = {Role.REPLAY: replay.serve("replay/insert")}
    watcher = raw_session(address, mode, **shown(certs / Role.WATCHER))
    with watcher:
        everything = watcher.declare_subscriber("gfm/**", zenoh.handlers.RingChannel(100))
        questions = watcher.declare_queryable("gfm/**", zenoh.handlers.RingChannel(100))

        def weights_arrived() -> bool:
            watcher.put("gfm/test/weights", b"forged")
            learner.publish("weights", RecordDone(path="learner", ticks=1))
            return heard.latest() == RecordDone(path="learner", ticks=1)

        def replay_answers() -> bool:
            pending = asker.request("replay/insert", StatusRequest(), timeout_s=4.0, everybody=True)
            return answerers(pending, servers) == {Role.REPLAY}

        eventually(weights_arrived)
        eventually(replay_answers)
        seen = {sample.payload.to_bytes() for sample in iter(everything.try_recv, None)}
        assert seen <= {b"forged"}  # its own
        assert questions.try_recv() is None
    assert not asker.rejected


def test_nobody_connects_without_a_certificate(address, certs, tmp_path):
    mine = shown(certs / Role.ACTOR)
    strange = certificates(tmp_path / "strangers") / Role.ACTOR
    authority = {"root_ca_certificate": mine["root_ca_certificate"]}
    with raw_session(address, **mine):  # so much for how it is done
        pass
    attempts = [
        {"endpoint": address.router.replace("tls", "tcp")},
        authority,
        shown(strange) | authority,
        shown(certs / Role.ROUTER),
    ]
    for attempt in attempts:
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            raw_session(address, **attempt)


def test_whoever_is_not_believed_is_told_why_at_once(address, certs, tmp_path):
    other = certificates(tmp_path / "other")
    with pytest.raises(BadInputError, match=r"router at tls/.*: its certificate is not believed: "):
        RunAddress(run="test", endpoint=address.router, certs=str(other)).open(Role.ACTOR)
    for name in ("key.pem", "certificate.pem"):
        (other / "learner" / name).write_bytes((other / "actor" / name).read_bytes())
    (other / "learner/authority.pem").write_bytes((certs / "actor/authority.pem").read_bytes())
    with pytest.raises(BadInputError, match=r"router at tls/.*: it refuses: "):
        RunAddress(run="test", endpoint=address.router, certs=str(other)).open(Role.LEARNER)


def test_certificates_that_have_expired_are_not_believed(tmp_path):
    certs = certificates(tmp_path, age=timedelta(days=2))
    at = RunAddress(run="test", endpoint=free_endpoint(secure=True), certs=str(certs))
    credentials = read_credentials(certs, Role.ROUTER)
    with (
        ZenohTransport.open(run="test", listen=[at.endpoint], credentials=credentials),
        pytest.raises(BadInputError, match="certificate has expired"),
    ):
        at.open(Role.ACTOR)


def test_a_client_does_not_believe_who_only_poses_as_the_router(certs):
    endpoint = free_endpoint(secure=True)
    actor = read_credentials(certs, Role.ACTOR)
    with (
        ZenohTransport.open(run="test", listen=[endpoint], credentials=actor),
        pytest.raises(BadInputError, match="its certificate is not believed"),
    ):
        RunAddress(run="test", endpoint=endpoint, certs=str(certs)).open(Role.LEARNER)


def test_the_router_counts_who_is_connected_by_their_certificates(certs):
    at = RunAddress(run="test", endpoint=free_endpoint(secure=True), certs=str(certs))
    credentials = read_credentials(certs, Role.ROUTER)
    with (
        ZenohTransport.open(run="test", listen=[at.endpoint], credentials=credentials) as router,
        at.open(Role.ACTOR, name="learner"),
        at.open(Role.ACTOR),
        at.open(Role.WATCHER),
    ):
        eventually(lambda: router.connected() == {"actor": 2, "watcher": 1})
