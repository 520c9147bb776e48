"""Many robots side by side, each with what it hides.

Integrated by the implicit midpoint rule, linearised in stiffness and damping, or by the explicit
one in shorter steps; dry friction is an impulse within its limits that stops a joint whenever it
can (Moreau's time stepping), so that a joint at rest stays there.

Where a joint has play or a spring, its motor (armature, drive, friction) is a side of its own: the
last degree of freedom of that robot.

Shape letters: B robots, J joints, N degrees of freedom (J, or J + 1), C commands, T measurements.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from known_truth import dynamics
from known_truth.amounts import amounts
from known_truth.commands import Commands
from known_truth.outside import SLIPPING, is_strange, outside
from known_truth.planted import side_by_side
from known_truth.robots import UPRIGHT, Array, Robot
from known_truth.run import Course, Run

#: Time for which the first command is held before a recording begins, s.
SETTLING_S = 1.0
#: Sweeps over the joints with dry friction.
_SWEEPS = 12
#: How much softer the flanks of play are that are integrated explicitly.
_SOFTER = 0.4
#: Where a slipping load comes to lie, in multiples of where it was.
_SLID = 0.3
#: Share of its torque that a drive loses at most.
_MOST_LOST = 0.5


def simulate(runs: Sequence[Run], settling_s: float = SETTLING_S) -> list[Course]:
    """Returns what robots of one build do, side by side.

    Args:
        runs: The robots, all with the same time step and integrator.
        settling_s: Time for which the first command is held before measurements begin.
    """
    robots = _Robots(runs)
    for step in _steps(runs, settling_s):
        robots.decide(step)
        robots.measure(step)
        robots.advance(step)
    return robots.courses()


def simulate_beside(
    leaders: Sequence[Run],
    others: Sequence[Run],
    segment_s: float,
    settling_s: float = SETTLING_S,
) -> list[tuple[Course, Course]]:
    """Returns what robots do, and what others do that begin anew beside them every so often.

    Others take the commands of their leaders, and begin each segment where these are: how far they
    come apart is how far an open-loop prediction does.

    Args:
        leaders: The robots.
        others: As many that differ from them.
        segment_s: From one new beginning to the next, s.
        settling_s: Time for which the first command is held before measurements begin.
    """
    robots = _Robots([*leaders, *others])
    count, every = len(leaders), round(segment_s / leaders[0].step_s)
    for step in _steps(leaders, settling_s):
        robots.decide(step)
        robots.follow(count, anew=step % every == 0)
        robots.measure(step)
        robots.advance(step)
    courses = robots.courses()
    return list(zip(courses[:count], courses[count:], strict=True))


def _steps(runs: Sequence[Run], settling_s: float) -> range:
    end = max(int(run.measured_at[-1]) for run in runs)
    return range(-round(settling_s / runs[0].step_s), end + 1)


@final
class _Robots:
    """The state of all robots, and how it changes."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self._runs = runs
        self._step_s, self._explicit = runs[0].step_s, runs[0].explicit
        self._planted = side_by_side([run.planted for run in runs])
        robots = [run.robot for run in runs]
        self._joints = len(robots[0].joints)
        named = [[h for h in run.hidden if not is_strange(h.effect)] for run in runs]
        self._has = amounts(named, robots)
        self._strange = [
            (i, h.joints[0], outside(h.effect, h.parameters))
            for i, run in enumerate(runs)
            for h in run.hidden
            if h.effect != SLIPPING and is_strange(h.effect)
        ]
        self._chains, self._nominal = dynamics.chains(robots), dynamics.chains(robots)
        for robot, mass, com in self._has.payload:
            self._chains.add_point_mass(robot, mass, com)
        self._slips = self._carried(runs)
        self._set_drives(runs)
        self._set_sides(runs)
        self._commands = Commands(runs, self._has)
        self._q = np.stack([self._on_motors(run.start) for run in runs])
        if self._dof > self._joints:
            rows = np.flatnonzero(self._apart)
            self._q[rows, -1] = self._q[rows, self._has.separated[rows]]
        self._v = np.zeros_like(self._q)
        self._acceleration = np.zeros_like(self._q)
        self._impulse = np.zeros_like(self._q)
        if self._explicit and self._dof > self._joints:
            self._soften_flanks()
        self._set_measurements(runs)

    def _carried(self, runs: Sequence[Run]) -> dict[int, list[tuple[int, float, Array]]]:
        """Lets robots carry loads that will slip; returns which ones do, by time step."""
        slips: dict[int, list[tuple[int, float, Array]]] = {}
        for robot, run in enumerate(runs):
            for values in (h.parameters for h in run.hidden if h.effect == SLIPPING):
                com = np.array([values[axis] for axis in ("com_x", "com_y", "com_z")])
                self._chains.add_point_mass(robot, values["mass"], com)
                # A load that is here no more and elsewhere instead, as two point masses.
                moves = [(robot, -values["mass"], com), (robot, values["mass"], _SLID * com)]
                slips.setdefault(round(values["at_s"] / self._step_s), []).extend(moves)
        return slips

    def _on_motors(self, values: Array) -> Array:
        return np.concatenate([values, np.zeros(self._dof - self._joints)])

    def _set_drives(self, runs: Sequence[Run]) -> None:
        """Sets gain on the command, stiffness and damping of every drive, each of shape (B, J)."""
        laws = [_drive_law(run.robot, run.kind) for run in runs]
        scale = self._has.scale
        self._gain, self._stiffness, self._damping = (
            scale * np.stack([law[i] for law in laws]) for i in range(3)
        )
        self._controlled = np.array([run.kind == "effort" for run in runs])
        self._control = [np.stack([run.control[i] for run in runs]) for i in range(2)]
        compensated = np.array([[run.robot.compensated] for run in runs])
        self._compensated = compensated.astype(float)
        self._upright = np.tile(UPRIGHT, (len(runs), 1))

    def _set_sides(self, runs: Sequence[Run]) -> None:
        """Sets what sits on links and on motors."""
        separated = self._has.separated
        self._apart = separated >= 0
        self._dof = self._joints + int(self._apart.any())
        size = (len(runs), self._dof)
        self._rows = np.arange(len(runs))[:, None]
        #: Degree of freedom of each joint's motor.
        self._motor = np.tile(np.arange(self._joints), (len(runs), 1))
        self._motor[self._apart, separated[self._apart]] = self._dof - 1
        self._inertia, self._friction_damping = np.zeros(size), np.zeros(size)
        armature = np.stack([run.robot.armature for run in runs]) + self._has.armature
        damping = np.stack([run.robot.damping for run in runs]) + self._has.viscous
        np.put_along_axis(self._inertia, self._motor, armature, axis=1)
        np.put_along_axis(self._friction_damping, self._motor, damping, axis=1)
        if self._dof > self._joints:
            self._inertia[~self._apart, -1] = 1.0
        self._declared = np.stack([run.robot.friction for run in runs])
        dry = self._declared + self._has.level + self._has.excess + self._has.load
        dry += np.abs(self._has.difference)
        for i, j, _ in self._strange:
            dry[i, j] += 1.0
        rough = np.zeros(size, dtype=bool)
        np.put_along_axis(rough, self._motor, dry > 0.0, axis=1)
        self._rough = np.flatnonzero(rough.any(axis=0))
        own_inertia = armature[np.arange(len(runs)), np.maximum(separated, 0)]
        self._flank_damping = 1.4 * np.sqrt(self._has.elastic * own_inertia)

    def _set_measurements(self, runs: Sequence[Run]) -> None:
        count = max(len(run.measured_at) for run in runs)
        self._at = np.full((len(runs), count), np.iinfo(np.intp).max)
        for i, run in enumerate(runs):
            self._at[i, : len(run.measured_at)] = run.measured_at
        self._next = np.zeros(len(runs), dtype=np.intp)
        self._measured = np.zeros((4, len(runs), count, self._joints))

    def _soften_flanks(self) -> None:
        """Lets flanks give way as gears' do, and damps them by what they move: links may be light.

        An explicit integrator follows neither stiffer ones nor a damping faster than they are.
        """
        rows = np.flatnonzero(self._apart)
        self._has.elastic[rows] *= np.where(self._has.gap[rows] > 0.0, _SOFTER, 1.0)
        self._passive(0, self._q, self._v)
        inverse = np.linalg.inv(self._mass)[rows]
        each, link = np.arange(len(rows)), self._has.separated[rows]
        mobility = inverse[each, link, link] + inverse[each, -1, -1]
        self._flank_damping[rows] = 1.4 * np.sqrt(self._has.elastic[rows] / mobility)

    def follow(self, count: int, *, anew: bool) -> None:
        """Gives the last robots what their leaders, the first `count`, are commanded.

        Args:
            count: How many lead.
            anew: Whether they begin anew, where their leaders are.
        """
        self._commands.values[count:] = self._commands.values[:count]
        if anew:
            for state in (self._q, self._v, self._acceleration, self._impulse):
                state[count:] = state[:count]

    def decide(self, step: int) -> None:
        """Lets the controllers of robots that take torques decide on their commands."""
        rows, number = self._commands.due(step)
        mine = self._controlled[rows]
        rows, number = rows[mine], number[mine]
        if rows.size:
            wanted = self._commands.values[rows, number]
            seen = self._q[rows, : self._joints] + self._has.encoder[rows]
            torque = self._control[0][rows] * (wanted - seen)
            torque -= self._control[1][rows] * self._v[rows, : self._joints]
            self._commands.values[rows, number] = torque

    def measure(self, step: int) -> None:
        """Keeps what sensors without error report at a step."""
        index = np.minimum(self._next, self._at.shape[1] - 1)
        rows = np.flatnonzero(self._at[np.arange(len(index)), index] == step)
        if not rows.size:
            return
        effort, _, _ = self._drive(step, self._q, self._v, self._commands.just_before(step))
        here = index[rows]
        self._measured[0, rows, here] = self._q[rows, : self._joints] + self._has.encoder[rows]
        self._measured[1, rows, here] = self._v[rows, : self._joints]
        self._measured[2, rows, here] = (effort - self._compensation(self._q))[rows]
        self._measured[3, rows, here] = effort[rows]
        self._next[rows] += 1

    def courses(self) -> list[Course]:
        """Returns what every robot did."""
        return [
            Course(
                position=self._measured[0, i, : len(run.measured_at)],
                velocity=self._measured[1, i, : len(run.measured_at)],
                servo=self._measured[2, i, : len(run.measured_at)],
                effort=self._measured[3, i, : len(run.measured_at)],
                command=self._commands.values[i, : len(run.reference)],
            )
            for i, run in enumerate(self._runs)
        ]

    def advance(self, step: int) -> None:
        """Lets one time step pass."""
        for robot, mass, com in self._slips.get(step, ()):
            self._chains.add_point_mass(robot, mass, com)
        if self._explicit:
            self._advance_explicitly(step)
        else:
            self._advance_implicitly(step)
        for i, j, law in self._strange:
            law.pass_time(self._step_s, float(self._v[i, self._motor[i, j]]))

    def _advance_explicitly(self, step: int) -> None:
        """Lets one time step pass by the explicit midpoint rule."""
        h, q, v = self._step_s, self._q, self._v
        command = self._commands.mean(step)
        force, _ = self._pushed(step, q, v, command)
        # Until the middle dry friction is what it was.
        rate = np.linalg.solve(self._mass, (force + self._impulse / h)[..., None])[..., 0]
        middle, half = q + 0.5 * h * v, v + 0.5 * h * rate
        force, effort = self._pushed(step + 0.5, middle, half, command)
        inverse = np.asarray(np.linalg.inv(self._mass), dtype=np.float64)
        after = v + (inverse @ (h * force)[..., None])[..., 0]
        if self._rough.size:
            after = self._rubbed(after, inverse, middle, half, effort)
        self._q, self._v = q + 0.5 * h * (v + after), after

    def _pushed(self, step: float, q: Array, v: Array, command: Array) -> tuple[Array, Array]:
        """Returns all forces but dry friction's, (B, N), and the drives', (B, J).

        Also sets the mass matrix.
        """
        effort, _, _ = self._drive(step, q, v, command)
        force, _, _ = self._passive(step, q, v)
        self._add_on_motors(force, effort)
        return force, effort

    def _advance_implicitly(self, step: int) -> None:
        """Lets one time step pass by the implicit midpoint rule."""
        h, v = self._step_s, self._v
        q = self._q + 0.5 * h * v
        effort, stiffness, damping = self._drive(step, q, v, self._commands.mean(step))
        force, stiff, damp = self._passive(step, q, v)
        self._add_on_motors(force, effort)
        motors = self._rows, self._motor
        stiff[(*motors, self._motor)] += stiffness
        damp[(*motors, self._motor)] += damping
        matrix = self._mass + 0.5 * h * damp + 0.25 * h**2 * stiff
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        after = v + (inverse @ (h * force)[..., None])[..., 0]
        if self._rough.size:
            after = self._rubbed(after, inverse, q, v, effort)
        self._q = self._q + 0.5 * h * (v + after)
        self._acceleration = (after - v) / h
        self._v = after

    def _drive(self, step: float, q: Array, v: Array, command: Array) -> tuple[Array, Array, Array]:
        """Returns the drives' torques, and their servos' stiffness and damping, each (B, J).

        A servo's torque is limited; of all that a drive gives, the weight that it bears included, a
        part is lost.
        """
        for i, j, law in self._strange:
            command[i, j] = law.command(float(command[i, j]))
        angle, speed = q[self._rows, self._motor], v[self._rows, self._motor]
        torque = self._gain * command - self._stiffness * (angle + self._has.encoder)
        torque -= self._damping * speed
        free = np.abs(torque) < self._has.limit
        torque = np.clip(torque, -self._has.limit, self._has.limit) + self._compensation(q)
        lost = self._has.loss * np.abs(torque)
        torque *= 1.0 - np.minimum(lost, _MOST_LOST)
        free &= np.abs(torque) > self._has.dead
        torque -= np.clip(torque, -self._has.dead, self._has.dead)
        left = free * np.where(lost < _MOST_LOST, 1.0 - 2.0 * lost, 1.0 - _MOST_LOST)
        for i, j, law in self._strange:
            torque[i, j] = law.drive(step * self._step_s, float(torque[i, j]), float(speed[i, j]))
        return torque, left * self._stiffness, left * self._damping

    def _compensation(self, q: Array) -> Array:
        """Returns what the controller adds against the gravity that it believes in, (B, J)."""
        if not self._compensated.any():
            return np.zeros((len(q), self._joints))
        seen = q[:, : self._joints] + self._has.encoder
        here = dynamics.pose(self._nominal, seen)
        return np.asarray(self._compensated * dynamics.weight(self._nominal, here, self._upright))

    def _passive(self, step: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Returns all forces but the drives' and dry friction's, (B, N), and their slopes.

        Also sets the mass matrix.
        """
        has, joints = self._has, self._joints
        link, extrapolated = q[:, :joints], v + 0.5 * self._step_s * self._acceleration
        here = dynamics.pose(self._chains, link)
        force = np.zeros_like(q)
        force[:, :joints] -= dynamics.bias(
            self._chains, here, extrapolated[:, :joints], has.gravity
        )
        self._mass = np.zeros((len(q), self._dof, self._dof))
        self._mass[:, :joints, :joints] = dynamics.mass_matrix(self._chains, here)
        diagonal = np.arange(self._dof)
        self._mass[:, diagonal, diagonal] += self._inertia
        force[:, :joints] -= has.spring * (link - has.spring_rest)
        speed = extrapolated[:, :joints]
        force[:, :joints] += has.offset - has.quadratic * speed * np.abs(speed)
        force[:, :joints] += has.cogging * np.sin(has.order * link + has.phase)
        for i, j, law in self._strange:
            force[i, j] += law.torque(step * self._step_s, float(link[i, j]), float(speed[i, j]))
        if self._planted is not None:
            force[:, :joints] += self._planted.torque(step * self._step_s, link, speed)
        stiff, damp = np.zeros_like(self._mass), np.zeros_like(self._mass)
        stiff[:, diagonal[:joints], diagonal[:joints]] = has.spring
        damp[:, diagonal, diagonal] = self._friction_damping
        damp[:, :joints, :joints] += has.coupled
        force -= (damp @ v[..., None])[..., 0]
        if self._dof > joints:
            self._couple(force, stiff, damp, q, v)
        return force, stiff, damp

    def _couple(self, force: Array, stiff: Array, damp: Array, q: Array, v: Array) -> None:
        """Adds what springs and flanks between motors and links do."""
        rows = np.flatnonzero(self._apart)
        link, elastic = self._has.separated[rows], self._has.elastic[rows]
        half = 0.5 * self._has.gap[rows]
        lead, rate = q[rows, -1] - q[rows, link], v[rows, -1] - v[rows, link]
        beyond = lead - np.clip(lead, -half, half)
        slope = np.where(half > 0.0, self._flank_damping[rows], 0.0)
        torque = elastic * beyond + slope * rate
        # Flanks push and never pull.
        pressed = (half == 0.0) | (torque * beyond > 0.0)
        torque, elastic, slope = pressed * torque, pressed * elastic, pressed * slope
        force[rows, link] += torque
        force[rows, -1] -= torque
        last = np.full_like(link, self._dof - 1)
        for matrix, amount in ((stiff, elastic), (damp, slope)):
            matrix[rows, link, link] += amount
            matrix[rows, last, last] += amount
            matrix[rows, link, last] -= amount
            matrix[rows, last, link] -= amount

    def _add_on_motors(self, force: Array, torque: Array) -> None:
        force[self._rows, self._motor] += torque

    def _rubbed(self, after: Array, inverse: Array, q: Array, v: Array, drive: Array) -> Array:
        """Returns velocities after dry friction, by projected Gauss-Seidel, shape (B, N)."""
        low, high = self._friction_limits(q, v, drive)
        impulse = np.clip(self._impulse, low, high)
        after = after + (inverse @ impulse[..., None])[..., 0]
        for _ in range(_SWEEPS if self._rough.size > 1 else 1):
            for j in self._rough:
                wanted = impulse[:, j] - after[:, j] / inverse[:, j, j]
                taken = np.clip(wanted, low[:, j], high[:, j])
                after = after + inverse[:, :, j] * (taken - impulse[:, j])[:, None]
                impulse[:, j] = taken
        self._impulse = impulse
        return np.asarray(after)

    def _friction_limits(self, q: Array, v: Array, drive: Array) -> tuple[Array, Array]:
        """Returns the least and the largest impulse that dry friction can give, (B, N)."""
        has = self._has
        angle, speed = q[self._rows, self._motor], v[self._rows, self._motor]
        level = self._declared + has.level + has.load * np.abs(drive)
        level += has.excess * np.exp(-((speed / has.fading) ** 2))
        for i, j, law in self._strange:
            level[i, j] += law.level(float(angle[i, j]), float(speed[i, j]))
        low, high = np.zeros_like(q), np.zeros_like(q)
        low[self._rows, self._motor] = -self._step_s * (level + 0.5 * has.difference)
        high[self._rows, self._motor] = self._step_s * (level - 0.5 * has.difference)
        return low, high


def _drive_law(robot: Robot, kind: str) -> tuple[Array, Array, Array]:
    """Returns gain on the command, stiffness and damping of a robot's drives, each (J,)."""
    nothing = np.zeros(len(robot.joints))
    match kind:
        case "position":
            return robot.stiffness, robot.stiffness, robot.servo_damping
        case "velocity":
            return robot.velocity_gain, nothing, robot.velocity_gain
        case _:
            return np.ones(len(robot.joints)), nothing, nothing
