"""What the robot bridge may be told."""

from __future__ import annotations

import hashlib
from typing import ClassVar, Literal

import msgspec

from gfm import __version__
from gfm.core import ConfigError
from gfm.service import ServiceConfig
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.limits import Bounds, Limits
from gfm_wire import RobotClock, Role

#: Speeds are commanded up to this part of what is allowed: when others change speed, a joint whose
#: servo is soft exceeds its setpoint (by 12 % in the worst of many tries in the simulated arm).
_HEADROOM = 0.88
#: An encoder that counts from farther away, rad, is no offset that anybody found by a motion.
_FARTHEST_ZERO = 0.5
#: A joint slower than this share of its velocity limit is at rest.
_STILL = 0.01


def address(text: str) -> tuple[str, int]:
    """Returns host and port of HOST:PORT.

    Raises:
        ConfigError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise ConfigError(f"ros is {text!r}, expected HOST:PORT of a rosbridge")
    return host, int(port)


class BridgeConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the robot bridge.

    Attributes:
        robot: sim: the simulated Sawyer in another process; mirror: a stand-in in this one; sawyer:
            a Sawyer behind a rosbridge.
        ros: HOST:PORT of that rosbridge.
        ros_latency_s: From when a command is sent to a Sawyer until it acts: 1.6 ms to its computer
            and 1 ms to its motors by the manufacturer, and a bridge more. Recordings are stamped by
            it; what is left of it is found by a diagnosis as a delay.
        robot_software: Versions of a Sawyer's software that are accepted; of others nobody here
            knows whether they understand the same.
        clock: wall: in real time, with a watchdog. lockstep: a simulated robot's time passes with
            every command, as fast as the machine can. As the robot's own setting.
        control_hz: Commands per second of robot time; at less than 10 the robot's own watchdog,
            after 0.2 s, would act between two of them.
        realtime: Whether its process runs before whatever is not real-time; on a busy machine
            that is what makes it punctual. It takes a right that not every user has.
        recordings: Folder for recordings.
        position_margin_rad: How far from the ends of the joint ranges commands stay.
        velocity_share: Share of the robot's velocity limits that is allowed, whatever share a
            command's task asks for.
        acceleration_share: Share of its acceleration limits by which setpoints change. Joints pull
            at one another: in the worst of 200 poses the simulated arm's speed servos, told to ramp
            as badly as possible, give a joint twice the acceleration of its own ramp.
        braking_share: The same for a stop, in which all joints only become slower.
        task: For which the robot has a tool in its hand and a basket in front of it; as the
            simulated robot's own setting.
        workspace_m: Lower corner x, y, z and upper corner x, y, z, in the robot's base frame: no
            part of the arm leaves that box. Empty for no box.
        clearance_m: Distance that the arm keeps from basket, ground and itself, and from the sides
            of the workspace.
        joint_zero_rad: What each joint reports where the published arm is at zero, as a diagnosis
            named it: distances are those of where the arm then is. Empty for 0.
        unnoticed_load_nm: A load that nobody told the robot of counts where a joint feels more of
            it than this: what noise and steps of setpoints make of none is less. A large number
            for a robot whose efforts are something else than its drives' torques.
        power_w: That torques may put into the arm; 80 W is what ISO 10218-1 allows near people.
        report_age_s: The robot is stopped where its newest report is older: as long as the robot
            itself waits for a command.
        behind_rad: How far a joint may fall behind what it is told ...
        behind_s: ... and for how long, before the robot is stopped: something holds it. 0.1 rad is
            where a position servo of the arm pushes with all that it has.
        flight_s: How much a flight record holds: of every stop one is written.
        flights_kept: How many of them are kept.
        object_age_s: A pose of the object that is older is none for whoever needs one: ten looks of
            a camera at 20 Hz.
        object_spread_m: Standard deviation of a tracked object's place, as its tracker documents it
        object_spread_rad: ... and of its turn; recordings carry both.
        command_age_s: A command stamped longer ago is refused (wall clock only). 0.2 s is how long
            the robot itself waits: what is older was made for another state of the arm.
        lease_s: Silence after which another driver may take the robot: longer than a driver needs
            between two motions, short enough for a person to wait for.
        watchdog_periods: Silence after which the robot is made to hold (wall clock only).
    """

    role: ClassVar[Role] = Role.ROBOT_BRIDGE

    robot: Literal["sim", "mirror", "sawyer"] = "sim"
    ros: str = ""
    ros_latency_s: float = 0.004
    robot_software: tuple[str, ...] = ("5.3.0", "5.3.1", "5.3.2")
    clock: RobotClock = RobotClock.WALL
    control_hz: float = 50.0
    realtime: bool = False
    recordings: str = "recordings"
    position_margin_rad: float = 0.05
    velocity_share: float = 0.5
    acceleration_share: float = 0.5
    braking_share: float = 0.7
    task: Literal["none", "position", "pose"] = "none"
    workspace_m: tuple[float, ...] = (-0.6, -0.9, -0.2, 1.15, 0.9, 1.2)
    clearance_m: float = 0.01
    joint_zero_rad: tuple[float, ...] = ()
    unnoticed_load_nm: float = 0.5
    power_w: float = 80.0
    report_age_s: float = 0.2
    behind_rad: float = 0.1
    behind_s: float = 0.25
    flight_s: float = 5.0
    flights_kept: int = 50
    object_age_s: float = 0.5
    object_spread_m: float = 0.001
    object_spread_rad: float = 0.01
    command_age_s: float = 0.2
    lease_s: float = 5.0
    watchdog_periods: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        ranges = {
            "control_hz": (10.0, 200.0),
            "position_margin_rad": (0.0, 0.5),
            "velocity_share": (0.01, 1.0),
            "acceleration_share": (0.01, 1.0),
            "braking_share": (0.1, 1.0),
            "clearance_m": (0.005, 0.05),
            "unnoticed_load_nm": (0.1, 1000.0),
            "power_w": (1.0, 1000.0),
            "report_age_s": (0.02, 10.0),
            "behind_rad": (0.01, 10.0),
            "behind_s": (0.0, 10.0),
            "flight_s": (0.1, 60.0),
            "flights_kept": (1, 10_000),
            "object_age_s": (0.02, 10.0),
            "object_spread_m": (0.0, 1.0),
            "object_spread_rad": (0.0, 3.2),
            "command_age_s": (0.01, 10.0),
            "lease_s": (0.5, 60.0),
            "watchdog_periods": (2, 100),
            "ros_latency_s": (0.0, 0.1),
        }
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ConfigError(f"{name} is {value}, expected {least} to {most}")
        box = self.workspace_m
        if box and not (len(box) == 6 and all(box[i] < box[i + 3] for i in range(3))):
            raise ConfigError(
                f"workspace_m is {list(box)}, expected a lower corner x, y, z and an upper one "
                "beyond it, or nothing"
            )
        zero = self.joint_zero_rad
        far = any(not abs(one) <= _FARTHEST_ZERO for one in zero)
        if zero and (len(zero) != len(JOINT_NAMES) or far):
            raise ConfigError(
                f"joint_zero_rad is {list(zero)}, expected {len(JOINT_NAMES)} angles of at most "
                f"{_FARTHEST_ZERO} rad, or nothing"
            )
        self._check_robot()

    def _check_robot(self) -> None:
        """Refuses settings of a robot that contradict one another, or are another's."""
        if self.realtime and self.clock == RobotClock.LOCKSTEP:
            raise ConfigError("clock is lockstep and realtime true, expected wall: nothing is late")
        if self.robot != "sawyer":
            if self.ros:
                raise ConfigError(f"ros is {self.ros} and robot {self.robot}, expected sawyer")
            return
        if self.clock == RobotClock.LOCKSTEP:
            raise ConfigError("clock is lockstep and robot sawyer, expected wall: its time passes")
        address(self.ros)
        if not self.certs:
            raise ConfigError(
                "robot is sawyer and there are no certificates, expected --certs: without, whoever "
                "reaches the router commands the arm"
            )

    def bounds(self, limits: Limits, patience_s: float) -> Bounds:
        """Returns within which setpoints of a robot stay; it stops by itself after its patience."""
        return Bounds(
            lower=limits.lower + self.position_margin_rad,
            upper=limits.upper - self.position_margin_rad,
            velocity=_HEADROOM * self.velocity_share * limits.velocity,
            velocity_limit=limits.velocity,
            acceleration=self.acceleration_share * limits.acceleration,
            braking=self.braking_share * limits.acceleration,
            effort=limits.effort,
            still=_STILL * limits.velocity,
            power_w=self.power_w,
            patience_s=patience_s + self.period_ns * 1e-9,
        )

    @property
    def about(self) -> dict[str, str]:
        """What recordings and flight records say of the bridge."""
        return {
            "run": self.run,
            "software": f"gfm {__version__}",
            "robot": self.robot,
            "clock": str(self.clock),
            "control_hz": f"{self.control_hz:g}",
            "velocity_share": f"{self.velocity_share:g}",
            "acceleration_share": f"{self.acceleration_share:g}",
            "config": msgspec.json.encode(self).decode(),
            "config_sha256": hashlib.sha256(msgspec.json.encode(self)).hexdigest(),
        }

    @property
    def period_ns(self) -> int:
        """Between two commands."""
        return round(1e9 / self.control_hz)
