"""A bridge and a Sawyer behind a rosbridge, as processes, to be driven and stopped."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from relay import Relay
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from gfm.core import (
    Command,
    CommandKind,
    GfmError,
    MonotonicClock,
    Observation,
    RefusedError,
    Status,
)
from gfm.core.checks import Array
from gfm.launch.own_certs import own_certificates
from gfm.launch.spec import free_endpoint
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import ZenohTransport, ask, read_credentials
from gfm_wire import Message, PowerAction, PowerRobot, Role, StatusRequest

PERIOD_S = 0.05
#: rad/s, of a mean over ten reports: sensors are as noisy as a tenth of that.
STILL = 0.01
CLOCK = MonotonicClock()
_LONGEST_WAIT_S = 120.0


def eventually(holds: Callable[[], object], what: str) -> None:
    """Returns when something holds; fails where it does not within two minutes."""
    deadline_s = time.monotonic() + _LONGEST_WAIT_S
    while not holds():
        if time.monotonic() > deadline_s:
            raise AssertionError(f"never: {what}")
        time.sleep(0.01)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What the witness saw at one time.

    Attributes:
        at_ns: When, on this process's clock.
        position: rad, shape (9,): of the head, the arm and the torso.
        velocity: rad/s, shape (9,).
    """

    at_ns: int
    position: Array
    velocity: Array


@final
class Witness:
    """Another client of the robot, past the bridge: it sees what the arm does, and presses.

    Attributes:
        seen: The newest of all, oldest first.
    """

    def __init__(self, port: int) -> None:
        self.seen: deque[Seen] = deque(maxlen=3000)
        self._url = f"ws://127.0.0.1:{port}"
        self._is_over = False
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def since(self, at_ns: int) -> list[Seen]:
        """Returns what it saw from then on."""
        return [seen for seen in tuple(self.seen) if seen.at_ns >= at_ns]

    def speed(self) -> float:
        """Returns the fastest joint's mean speed over the next ten reports, rad/s."""
        now_ns = CLOCK.now_ns()
        eventually(lambda: len(self.since(now_ns)) >= 10, "the robot reports")
        return float(np.abs(np.mean([s.velocity for s in self.since(now_ns)], axis=0)).max())

    def press(self, *, pressed: bool) -> None:
        """Presses the e-stop button, or releases it."""
        call = {"op": "call_service", "service": "/simulated/estop_button"}
        with connect(self._url) as line:
            line.send(json.dumps({**call, "args": {"data": pressed}}))
            line.recv(timeout=5.0)

    def close(self) -> None:
        """Looks away."""
        self._is_over = True
        self._thread.join()

    def _watch(self) -> None:
        with suppress(ConnectionClosed), connect(self._url, compression=None) as line:
            line.send('{"op": "subscribe", "topic": "/robot/joint_states"}')
            while not self._is_over:
                msg = json.loads(line.recv(timeout=5.0))["msg"]
                at_ns = CLOCK.now_ns()
                position, velocity = np.array(msg["position"]), np.array(msg["velocity"])
                self.seen.append(Seen(at_ns=at_ns, position=position, velocity=velocity))


@final
class Cell:
    """A router in this process; bridge and robot in theirs, a relay between them.

    Args:
        folder: For recordings.
        stack: That ends everything.
        line: Flags of the line to the robot.
        bridge: Flags of the bridge, beside those that join it to the rest.

    Attributes:
        witness: Sees the arm past the bridge.
        relay: Between bridge and robot.
        bridge: The bridge's process.
    """

    def __init__(
        self,
        folder: Path,
        stack: ExitStack,
        line: Sequence[str] = (),
        bridge: Sequence[str] = (),
    ) -> None:
        self._folder, self._stack, self._flags = folder, stack, bridge
        self._endpoint, self._certs = free_endpoint(secure=True), folder / "certs"
        own_certificates(self._certs)
        credentials = read_credentials(self._certs, Role.ROUTER)
        self._port = int(free_endpoint().rpartition(":")[2])
        self._transport = stack.enter_context(
            ZenohTransport.open(run="cell", listen=[self._endpoint], credentials=credentials)
        )
        self._number = 0
        module = "gfm_robot_bridge.rosbridge_sawyer"
        self._robot = self._started(module, "--ros", f"127.0.0.1:{self._port}", *line)
        eventually(self._robot_listens, "the robot listens")
        self.relay = Relay(self._port)
        stack.callback(lambda: self.relay.cut())
        self.witness = Witness(self._port)
        stack.callback(self.witness.close)
        self.bridge = self.start_bridge()

    @property
    def goes_on(self) -> bool:
        """Whether the robot's process does: on a machine that is too busy it ends with a line."""
        return self._robot.poll() is None

    def start_bridge(self) -> subprocess.Popen[bytes]:
        """Starts a bridge, and returns its process when it answers."""
        self.bridge = self._started(
            *("gfm_robot_bridge", "--robot", "sawyer", "--ros", f"127.0.0.1:{self.relay.port}"),
            *("--control-hz", "20", "--recordings", str(self._folder), "--name", "bridge"),
            *("--run", "cell", "--connect", self._endpoint, "--certs", str(self._certs)),
            *self._flags,
        )
        eventually(self._bridge_answers, "the bridge answers")
        return self.bridge

    def cut(self) -> int:
        """Cuts the line between bridge and robot; returns on which port it was."""
        self.relay.cut()
        return self.relay.port

    def mend(self) -> None:
        """Lays the line again."""
        ticks = self.status().counters["ticks"]
        self.relay = Relay(self._port, self.relay.port)
        eventually(lambda: self.status().counters["ticks"] > ticks, "the bridge hears reports")

    def status(self) -> Status:
        """Returns what the bridge says of itself."""
        answer = self.ask("status/robot_bridge/bridge", StatusRequest())
        if not isinstance(answer, Status):
            raise TypeError(f"got {type(answer).__name__}, expected Status")
        return answer

    def ask(self, key: str, message: Message, timeout_s: float = 2.0) -> Message:
        """Returns the bridge's answer."""
        return ask(self._transport, key, message, timeout_s=timeout_s, clock=CLOCK)

    def power(self, action: PowerAction) -> None:
        """Switches the robot's drives."""
        self.ask("robot/power", PowerRobot(action=action), timeout_s=8.0)

    def make_ready(self) -> None:
        """Clears and enables, as a person would."""
        self.witness.press(pressed=False)
        eventually(lambda: "button is pressed" not in self.status().note, "the bridge sees it")
        with suppress(RefusedError):  # there is nothing to reset
            self.power(PowerAction.RESET)
        self.power(PowerAction.ENABLE)
        eventually(lambda: "not enabled" not in self.status().note, "the bridge sees it")
        eventually(lambda: self.witness.speed() < STILL, "the arm is still")

    def command(self, speed: float, *, begins: bool = False) -> Observation:
        """Commands a speed of all joints, rad/s, and returns the answer."""
        values = np.full(len(JOINT_NAMES), speed)
        return self.send(CommandKind.VELOCITY, values, begins=begins)

    def send(self, kind: CommandKind, values: Array, *, begins: bool = False) -> Observation:
        """Commands values of all joints, shape (7,), and returns the answer."""
        self._number = 0 if begins else self._number + 1
        command = Command(
            kind=kind,
            joint_names=JOINT_NAMES,
            values=values,
            stamp_ns=CLOCK.utc_ns(),
            number=self._number,
        )
        answer = self.ask("robot/command", command)
        if not isinstance(answer, Observation):
            raise TypeError(f"got {type(answer).__name__}, expected Observation")
        return answer

    def refusal(self, *, begins: bool = False) -> str:
        """Returns why a command is refused; fails where it is not."""
        try:
            self.command(0.1, begins=begins)
        except RefusedError as error:
            return str(error)
        raise AssertionError("it is not refused")

    def drive(self, speed: float, seconds: float) -> Observation:
        """Commands a speed at 20 Hz; the first command begins a session."""
        due_ns, answer = CLOCK.now_ns(), self.command(speed, begins=True)
        for _ in range(round(seconds / PERIOD_S)):
            due_ns += round(PERIOD_S * 1e9)
            CLOCK.sleep_until_ns(due_ns)
            answer = self.command(speed)
        return answer

    def _started(self, module: str, *argv: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen([sys.executable, "-m", module, *argv])
        self._stack.callback(end, process)
        return process

    def _bridge_answers(self) -> bool:
        if not self.goes_on or self.bridge.poll() is not None:
            raise AssertionError("the robot or the bridge ended; it said why")
        with suppress(GfmError):
            self.status()
            return True
        return False

    def _robot_listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self._port)) == 0


def end(process: subprocess.Popen[bytes]) -> int:
    """Tells a process to end, and returns its exit status."""
    process.send_signal(signal.SIGTERM)
    try:
        return process.wait(timeout=15)
    finally:
        process.kill()
        process.wait()
