"""Serves the simulated Sawyer as a rosbridge does."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any, final

import numpy as np
from typing_extensions import override

from gfm.core import Clock, RefusedError, Status
from gfm.service import Service, make_status
from gfm_robot_bridge.intera.topics import (
    GET_PARAM,
    JOINT_LIMITS,
    JOINT_STATES,
    STATE,
    VERSION_PARAM,
    Topic,
)
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.controller import Controller
from gfm_robot_bridge.rosbridge_sawyer.door import Door, Said
from gfm_robot_bridge.rosbridge_sawyer.messages import joint_states, limits_message, read_switch
from gfm_robot_bridge.rosbridge_sawyer.weather import Path, Weather
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.simulated.pace import WallPace
from gfm_robot_bridge.simulated.robot import SimulatedRobot

ESTOP_BUTTON = "/simulated/estop_button"
"""Service of the type std_srvs/SetBool that presses the e-stop button, or releases it."""

JOINT_FAULT = "/simulated/joint_fault"
"""Service of the type std_srvs/Trigger that has a joint report a fault."""


@final
class RosbridgeService(Service):
    """Answers the operations of the protocol that a client of one robot needs.

    Args:
        config: Its settings.
        robot: At rest, at its time 0.
        door: At which clients come in.
        clock: Of this process.
    """

    def __init__(
        self, config: RosbridgeConfig, robot: SimulatedRobot, door: Door, clock: Clock
    ) -> None:
        self._config = config
        self._robot = robot
        self._door = door
        self._clock = clock
        # A ROS robot has no other clock to be put on; whoever drives it sees its reports grow old.
        self._pace = WallPace(robot, clock, slips=True)
        self._controller = Controller(robot)
        #: Of the robot's clock at its time 0.
        self._epoch_ns = clock.utc_ns() + round(config.clock_ahead_s * 1e9)
        weather = Weather(latency_s=config.latency_s, jitter_s=config.jitter_s, loss=config.loss)
        inward, outward = (np.random.default_rng([config.seed, 0x0A1, way]) for way in range(2))
        self._inward: Path[Said] = Path(weather, inward)
        self._outward: Path[tuple[int, Mapping[str, Any]]] = Path(weather, outward)
        self._subscribers: defaultdict[str, set[int]] = defaultdict(set)
        self._counters: Counter[str] = Counter(published=0, rejected_messages=0)

    @override
    def step(self) -> bool:
        reports, behind = self._pace.keep_up()
        for report in reports:
            self._publish(JOINT_STATES, joint_states(report, self._epoch_ns + report.stamp_ns))
            self._publish(STATE, self._controller.state())
        now_ns, heard = self._clock.now_ns(), False
        while (said := self._door.receive()) is not None:
            is_topic = said.op is not None and said.op.get("op") == "publish"
            self._inward.put(said, now_ns, may_be_lost=is_topic)
            heard = True
        for said in self._inward.arrived(now_ns):
            self._answer(said)
        for client, op in self._outward.arrived(now_ns):
            self._door.send(client, op)
        return behind or heard

    @override
    def status(self) -> Status:
        return make_status("robot", self._config.name, counters=self._counters)

    @override
    def close(self) -> None:
        self._door.close()

    def _answer(self, said: Said) -> None:
        if said.op is None:
            for clients in self._subscribers.values():
                clients.discard(said.client)
            return
        try:
            self._do(said.client, said.op)
        except RefusedError as error:
            self._counters["rejected_messages"] += 1
            self._send(said.client, {"op": "status", "level": "error", "msg": str(error)}, said.op)

    def _do(self, client: int, op: Mapping[str, Any]) -> None:
        """Does what an operation asks.

        Raises:
            RefusedError: it is unknown, or what it carries is not as declared.
        """
        match op.get("op"):
            case "subscribe":
                self._subscribers[str(op.get("topic"))].add(client)
                if op.get("topic") == JOINT_LIMITS.name:
                    self._send_limits(client)
            case "unsubscribe":
                self._subscribers[str(op.get("topic"))].discard(client)
            case "advertise" | "unadvertise":
                pass
            case "publish":
                self._controller.hear(str(op.get("topic")), op.get("msg"), self._pace.wall_ns)
            case "call_service":
                self._call(client, op)
            case other:
                raise RefusedError(f"op {other!r}, expected one of rosbridge's version 2")

    def _call(self, client: int, op: Mapping[str, Any]) -> None:
        args = op.get("args")
        values: dict[str, Any] = {"success": True, "message": ""}
        match op.get("service"):
            case service if service == GET_PARAM:
                values = {"value": self._param(args)}
            case service if service == ESTOP_BUTTON:
                self._controller.press(pressed=read_switch(args))
            case service if service == JOINT_FAULT:
                self._controller.break_joint()
            case service:
                raise RefusedError(f"there is no service {service}")
        answer = {
            "op": "service_response",
            "service": op.get("service"),
            "values": values,
            "result": True,
        }
        self._send(client, answer, op)

    def _param(self, args: object) -> str:
        """Returns a parameter as JSON in a string, as rosapi does."""
        asked = args if isinstance(args, dict) else {}
        if asked.get("name") == VERSION_PARAM:
            return json.dumps(self._config.software)
        return json.dumps(asked.get("default", ""))

    def _publish(self, topic: Topic, msg: Mapping[str, Any]) -> None:
        now_ns = self._clock.now_ns()
        op = {"op": "publish", "topic": topic.name, "msg": msg}
        for client in self._subscribers[topic.name]:
            self._counters["published"] += 1
            self._outward.put((client, op), now_ns, may_be_lost=True)

    def _send_limits(self, client: int) -> None:
        """Sends what is latched to who came late."""
        msg = limits_message(sawyer_limits())
        self._send(client, {"op": "publish", "topic": JOINT_LIMITS.name, "msg": msg}, {})

    def _send(self, client: int, op: dict[str, Any], asked: Mapping[str, Any]) -> None:
        if "id" in asked:
            op["id"] = asked["id"]
        self._outward.put((client, op), self._clock.now_ns(), may_be_lost=False)
