"""What certificates cost: connecting, asking and streaming with them and without, in turns.

    python benchmarks/tls.py --tries 7

Router, a server and this client are processes of this machine. The server answers as replay and
learner do; the client is an actor. With certificates every link is by TLS and the router checks
who who may speak; without, neither. Each try does everything once with each, in turns, so that what
else goes on on the machine meets both. The router's processor time tells more than rates on a
machine that is busy: it decrypts and encrypts everything, and waits for nothing.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from gfm.core import GfmError, MonotonicClock, Sequence, Weights
from gfm.launch import RunAddress, Supervisor, SystemSpec, free_endpoint, router_process
from gfm.launch.certs import make_certificates
from gfm.transport import PendingReply, Transport, ask
from gfm_wire import Message, Role, SequenceAck, WeightsRequest

OBSERVATION, ACTION = 48, 7
SHORT, LONG = 1, 600  # transitions: as bodies 0.7 KiB and 136 KiB
TENSOR = (512, 512)  # as a body 1 MiB
_TIMEOUT_S = 60.0
_POLL_S = 20e-6


def sequence(length: int) -> Sequence:
    """Returns a sequence of so many transitions."""
    return Sequence(
        actor="a",
        epoch=1,
        number=0,
        weights_life=1,
        weights_version=1,
        spec_digest="d",
        observation=np.zeros((length + 1, OBSERVATION), np.float32),
        action=np.zeros((length, ACTION), np.float32),
        reward=np.zeros(length, np.float32),
        discount=np.ones(length, np.float32),
        log_prob=np.zeros(length, np.float32),
    )


STREAMS: tuple[tuple[str, str, Message, int, int], ...] = (
    ("questions of 0.7 KiB, 1 at a time", "replay/insert", sequence(SHORT), 300, 1),
    ("questions of 0.7 KiB, 8 at a time", "replay/insert", sequence(SHORT), 1000, 8),
    ("questions of 136 KiB, 8 at a time", "replay/insert", sequence(LONG), 400, 8),
    ("answers of 1 MiB, 8 at a time", "weights/current", WeightsRequest(), 100, 8),
)
"""Name, key, question, how many of them, and how many under way at a time."""


def serve(address: RunAddress, ready: multiprocessing.synchronize.Event) -> None:
    """Answers as replay and learner do, until it is terminated."""
    acknowledged = SequenceAck(actor="a", epoch=1, number=0, cursor=1)
    tensors = {"w": np.zeros(TENSOR, np.float32)}
    weights = Weights(version=1, created_ns=0, spec_digest="d", tensors=tensors)
    with address.open(Role.REPLAY) as replay, address.open(Role.LEARNER) as learner:
        answers: list[tuple[object, Message]] = [
            (replay.serve("replay/insert"), acknowledged),
            (learner.serve("weights/current"), weights),
        ]
        ready.set()
        while True:
            idle = True
            for server, answer in answers:
                if (request := server.receive()) is not None:
                    request.reply(answer)
                    idle = False
            if idle:
                time.sleep(_POLL_S)


@contextmanager
def system(folder: Path, certs: str) -> Iterator[tuple[RunAddress, int]]:
    """Yields where a router and the server run, and the router's process id."""
    spec = SystemSpec(
        run="bench",
        endpoint=free_endpoint(secure=bool(certs)),
        processes=(router_process(),),
        certs=certs,
        insecure=not certs,
    )
    spawning = multiprocessing.get_context("spawn")
    ready = spawning.Event()
    with Supervisor(spec, folder) as supervisor:
        supervisor.start()
        server = spawning.Process(target=serve, args=(spec.address, ready))
        server.start()
        try:
            ready.wait(60.0)
            with spec.address.open(Role.ACTOR) as client:
                until_answered(client)
            yield spec.address, supervisor.children[0].pid
        finally:
            server.terminate()
            server.join()


def until_answered(client: Transport) -> None:
    """Returns once the server can be asked."""
    while True:
        try:
            ask_once(client, "replay/insert", sequence(SHORT))
        except GfmError:
            time.sleep(0.05)
        else:
            return


def ask_once(client: Transport, key: str, message: Message) -> Message:
    """Returns the answer to a question."""
    return ask(client, key, message, timeout_s=_TIMEOUT_S, clock=MonotonicClock())


def connecting_s(address: RunAddress, count: int) -> float:
    """Returns how long one connection takes, the median of several."""
    taken = []
    for _ in range(count):
        began_s = time.perf_counter()
        client = address.open(Role.ACTOR)
        taken.append(time.perf_counter() - began_s)
        client.close()
    return statistics.median(taken)


def per_s(client: Transport, key: str, message: Message, count: int, window: int) -> float:
    """Returns how many questions a second are answered, `window` of them under way at a time."""
    pending: deque[PendingReply] = deque()
    began_s = time.perf_counter()
    for _ in range(count):
        if len(pending) == window:
            wait(pending.popleft())
        pending.append(client.request(key, message, timeout_s=_TIMEOUT_S))
    for reply in pending:
        wait(reply)
    return count / (time.perf_counter() - began_s)


def wait(reply: PendingReply) -> None:
    """Returns once there is an answer."""
    while reply.poll() is None:
        time.sleep(_POLL_S)


def processor_s(pid: int) -> float:
    """Returns the processor time that a process has used."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measured(address: RunAddress, router: int) -> dict[str, float]:
    """Returns every figure once."""
    figures = {"connect, ms": 1e3 * connecting_s(address, 20)}
    with address.open(Role.ACTOR) as client:
        ask_once(client, "replay/insert", sequence(LONG))
        for name, key, message, count, window in STREAMS:
            before_s = processor_s(router)
            figures[f"{name}, per s"] = per_s(client, key, message, count, window)
            used_s = processor_s(router) - before_s
            figures[f"{name}, router's processor time for each, ms"] = 1e3 * used_s / count
    return figures


def table(plain: list[dict[str, float]], secure: list[dict[str, float]]) -> str:
    """Returns medians over the tries, and the ratio of each try: its median and its range."""
    lines = ["| | without | with | with / without | range |", "|---|---|---|---|---|"]
    for name in plain[0]:
        without, having = [one[name] for one in plain], [one[name] for one in secure]
        ratios = sorted(b / a for a, b in zip(without, having, strict=True))
        lines.append(
            f"| {name} | {statistics.median(without):.3g} | {statistics.median(having):.3g} | "
            f"{statistics.median(ratios):.2f} | {ratios[0]:.2f} to {ratios[-1]:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measures and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--tries", type=int, default=7)
    tries = parser.parse_args().tries
    plain, secure = [], []
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        list(make_certificates(folder / "certs", (), days=1, now=datetime.now(UTC)))
        without = stack.enter_context(system(folder / "without", ""))
        having = stack.enter_context(system(folder / "with", str(folder / "certs")))
        for number in range(tries):
            both = [(plain, without), (secure, having)]
            for figures, (address, router) in both if number % 2 == 0 else reversed(both):
                figures.append(measured(address, router))
    print(table(plain, secure))


if __name__ == "__main__":
    main()
