"""What sensors make of a course, and how it is written down: MCAP with ROS 2 messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mcap_ros2.writer
import numpy as np

from known_truth.robots import Array
from known_truth.run import Course, Run

_JOINT_STATE = """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
#: Of recordings' starts: some time in 2025, s.
_EPOCH_S = 1_750_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensors:
    """What is reported, and how well.

    Attributes:
        encoder_step: To which positions are rounded, rad.
        encoder_noise: Standard deviation before rounding, rad.
        velocity_noise: rad/s; None where velocities are not reported.
        effort_noise: N m, shape (J,); None where efforts are not reported.
        stamp_noise_s: Standard deviation of what is wrong with stamps, s.
    """

    encoder_step: float
    encoder_noise: float
    velocity_noise: float | None
    effort_noise: Array | None
    stamp_noise_s: float = 0.0

    @property
    def position_std(self) -> float:
        """Standard deviation of what is wrong with positions, rad."""
        return float(np.hypot(self.encoder_noise, self.encoder_step / np.sqrt(12.0)))


def write_recording(
    path: Path, run: Run, course: Course, sensors: Sensors, rng: np.random.Generator
) -> None:
    """Writes one recording, as the robot's logger would."""
    noisy = course.position + sensors.encoder_noise * rng.standard_normal(course.position.shape)
    fields: dict[str, Array] = {"position": _rounded(noisy, sensors.encoder_step)}
    if sensors.velocity_noise is not None:
        noise = sensors.velocity_noise * rng.standard_normal(noisy.shape)
        fields["velocity"] = course.velocity + noise
    if sensors.effort_noise is not None:
        noise = sensors.effort_noise * rng.standard_normal(noisy.shape)
        fields["effort"] = course.effort + noise
    end = int(run.measured_at[-1])
    commanded_at = run.first_command_step + run.command_every * np.arange(len(course.command))
    told = commanded_at <= end
    states = [
        ("/joint_states", int(at), row)
        for at, row in zip(run.measured_at, _rows(fields), strict=True)
    ]
    commands = [
        ("/joint_command", int(at), {run.kind: row})
        for at, row in zip(commanded_at[told], course.command[told], strict=True)
    ]
    messages = sorted([*commands, *states], key=lambda message: message[1])
    start_ns = _EPOCH_S * 10**9 + int(rng.integers(10**15))
    times_s = run.step_s * np.array([step for _, step, _ in messages])
    if sensors.stamp_noise_s:
        times_s = times_s + sensors.stamp_noise_s * rng.standard_normal(len(times_s))
    stamps_ns = [start_ns + round(float(time_s) * 1e9) for time_s in times_s]
    _write(path, run.robot.joints, messages, stamps_ns)


def _rounded(values: Array, step: float) -> Array:
    return np.asarray(step * np.round(values / step))


def _rows(fields: Mapping[str, Array]) -> list[dict[str, Array]]:
    count = len(fields["position"])
    return [{name: values[i] for name, values in fields.items()} for i in range(count)]


def _write(
    path: Path,
    joints: Sequence[str],
    messages: Sequence[tuple[str, int, Mapping[str, Array]]],
    stamps_ns: Sequence[int],
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        writer = mcap_ros2.writer.Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", _JOINT_STATE)
        for (topic, _, fields), stamp_ns in zip(messages, stamps_ns, strict=True):
            seconds, rest = divmod(stamp_ns, 10**9)
            message: dict[str, object] = {
                "header": {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": ""},
                "name": list(joints),
            }
            for name in ("position", "velocity", "effort"):
                message[name] = fields[name].tolist() if name in fields else []
            writer.write_message(topic, schema, message, log_time=stamp_ns, publish_time=stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]
