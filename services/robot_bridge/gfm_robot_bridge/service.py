"""Stands between whoever commands and the robot."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Clock, GfmError, Observation, Status
from gfm.service import Service, make_status
from gfm.transport import Transport
from gfm_robot_bridge.background import AtOnce, Background
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.content import content_of
from gfm_robot_bridge.desk import Desk
from gfm_robot_bridge.flight import FlightRecord
from gfm_robot_bridge.grid import Grid
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.load import LoadObserver
from gfm_robot_bridge.object_port import ObjectPort
from gfm_robot_bridge.pilot import Pilot
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.robot_line import RobotLine
from gfm_robot_bridge.timing import Timing
from gfm_wire import RobotClock

_log = logging.getLogger(__name__)

OBSERVATION = "robot/observation"
_RETRY_NS = 1_000_000_000
#: A stop takes less than this, or the robot does not answer.
_LONGEST_STOP_NS = 1_000_000_000
_POLL_NS = 500_000
_LONGEST_WRITE_S = 5.0


@final
class BridgeService(Service):
    """Serves what is under `robot/`, with `Pilot` and `Desk`; publishes `robot/observation`.

    A Command is answered, a control period later, by the newest Observation; it says what was
    applied and why that differs. On the lockstep clock the robot's time passes only in these
    periods, and while the robot is stopped. On the wall clock the robot's reports are read every
    period, the command is decided by them and sent, and silence trips the watchdog.

    Args:
        config: Its settings.
        robot: To drive.
        transport: The connection to whoever commands.
        clock: Of this process.
        background: That writes recordings; by default they are written at once.
        guard: Of what the arm must not touch; None where no model tells.
        observer: Of the load that the arm bears; None where no model tells.
    """

    def __init__(
        self,
        config: BridgeConfig,
        robot: Robot,
        transport: Transport,
        clock: Clock,
        background: Background | None = None,
        guard: Guard | None = None,
        observer: LoadObserver | None = None,
    ) -> None:
        self._config = config
        self._robot = robot
        self._transport = transport
        self._clock = clock
        self._guard = guard
        self._observer = observer
        if guard is None:
            _log.warning("no model of this robot: nothing keeps it from running into something")
        lease = Lease("the robot", round(config.lease_s * 1e9))
        folder, background = Path(config.recordings), background or AtOnce()
        content = content_of(config, robot)
        self._recorder = Recorder(folder, self._about, background, content)
        periods = math.ceil(config.flight_s * config.control_hz)
        self._flight = FlightRecord(folder / "flight", periods, config.flights_kept, background)
        oldest_ns = round(config.object_age_s * 1e9)
        self._objects = ObjectPort(transport, clock, config.clock, oldest_ns)
        self._timing = Timing()
        self._pilot = Pilot(
            config,
            robot,
            transport,
            clock,
            lease=lease,
            guard=guard,
            observer=observer,
            objects=self._objects,
            timing=self._timing,
            stood=self._record_flight,
        )
        self._desk = Desk(transport, clock, robot, self._recorder, lease, controls=self._pilot)
        self._line = RobotLine(robot, clock, self._recorder, self._flight, self._objects)
        self._grid = Grid(config.period_ns, clock.now_ns())
        self._reads = False
        self._began_ns = self._ticks = self._overruns = 0

    @override
    def step(self) -> bool:
        if self._line.under_way:
            return self._continue_exchange()
        answered = self._desk.answer()
        for seen in self._objects.hear(self._robot.time_ns()):
            self._recorder.tracked(seen)
        return self._tick() or answered

    @override
    def due_ns(self) -> int | None:
        waits = self._line.newest is None or self._config.clock == RobotClock.WALL
        return self._grid.next_ns if waits and not self._line.under_way else None

    def _tick(self) -> bool:
        """Begins a period where it is time for one; returns whether it was."""
        if self._line.newest is None or self._config.clock == RobotClock.WALL:
            return self._tick_on_time()
        return self._tell_next(self._line.newest)

    @override
    def status(self) -> Status:
        counters = {**self._pilot.counters, **self._objects.counters, **self._robot.counters()}
        counters |= {
            "ticks": self._ticks,
            "overruns": self._overruns,
            "recordings": self._recorder.finished,
            "lost_recordings": self._recorder.failed,
            "flight_records": self._flight.written,
        }
        counters["rejected_messages"] += self._desk.rejected + self._objects.rejected
        gauges = {
            "robot_time_s": self._robot.time_ns() * 1e-9,
            "geometry_guarded": float(self._guard is not None),
            "waits_for_reset": float(self._pilot.waits_for_reset),
            **self._robot.gauges(),
        }
        if self._observer is not None:
            gauges["unknown_load_nm"] = float(np.abs(self._observer.torque).max(initial=0.0))
        return make_status(
            "robot_bridge",
            self._config.name,
            counters=counters | self._timing.counters(),
            gauges=gauges | self._timing.gauges(),
            note=self._pilot.note,
        )

    @override
    def close(self) -> None:
        """Leaves the robot at rest (its own watchdog stands behind this), the recording whole."""
        self._pilot.shut("the bridge is closed")
        if self._line.newest is not None:
            self._pilot.stop("the bridge is closed")
        until_ns = self._clock.now_ns() + _LONGEST_STOP_NS
        while self._pilot.is_stopping and self._clock.now_ns() < until_ns:
            if not self.step():
                self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        self._pilot.end_stop()
        self._robot.close()
        self._recorder.close(_LONGEST_WRITE_S)

    def _tick_on_time(self) -> bool:
        """Begins the exchange of a period when it is due (the first one also in lockstep)."""
        begun = self._grid.begun(self._clock.now_ns())
        if begun is None:
            return False
        self._reads = self._line.newest is not None
        if self._reads:
            self._overruns += begun.missed
            self._timing.jitter.add(begun.late_ns)
        self._began_ns = begun.now_ns
        self._line.ask(self._config.period_ns if self._reads else 0)
        return True

    def _about(self) -> dict[str, str]:
        return {**self._config.about, **self._robot.about()}

    def _record_flight(self, why: str) -> None:
        self._flight.write(why, self._clock.utc_ns(), self._about())

    def _tell_next(self, newest: Observation) -> bool:
        """Tells the robot what is next; returns whether there is anything.

        In lockstep a period passes with that.
        """
        decision = self._pilot.decide(newest)
        if decision is None:
            return False
        lockstep = self._config.clock == RobotClock.LOCKSTEP
        sent_ns = self._line.tell(decision, self._config.period_ns if lockstep else 0)
        if not lockstep:
            self._timing.delays.add(sent_ns - self._began_ns)
        return True

    def _continue_exchange(self) -> bool:
        try:
            passed_ns = self._line.poll()
        except GfmError as error:
            self._fail(f"robot: {error}")
            return True
        if passed_ns is None:
            return False
        reads, self._reads = self._reads, False
        newest = self._line.newest
        if newest is None:
            return True
        self._pilot.look(newest, passed_ns * 1e-9, self._line.reports)
        if not (reads and self._tell_next(newest)):
            self._end_period(newest)
        return True

    def _end_period(self, newest: Observation) -> None:
        """Publishes the newest report, by which the last command is answered."""
        self._ticks += 1
        self._recorder.period(newest)
        self._transport.publish(OBSERVATION, newest)
        self._pilot.answer(newest)

    def _fail(self, problem: str) -> None:
        """The robot did not answer: the next try waits a little."""
        self._line.drop()
        self._reads = False
        self._grid.next_ns = self._clock.now_ns() + _RETRY_NS
        self._pilot.fail(problem, self._grid.next_ns)
