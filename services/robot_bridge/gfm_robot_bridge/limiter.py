"""From commands to what the robot is told: limited, without a jump, and stopped by a ramp.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import final

import numpy as np

from gfm.core import Command, CommandKind, Observation, Reason
from gfm.core.checks import Array
from gfm_robot_bridge.following import LAG_S, Told
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.limits import Bounds, limited_position, limited_speed
from gfm_robot_bridge.load import Load, Loaded, LoadObserver, by_load
from gfm_robot_bridge.plan import SPACING_S, Plan, positions, smaller, speeds
from gfm_robot_bridge.torque import Dynamics, limited_torque

#: A speed servo follows its setpoint by at most so much later, s: the arm stretched out.
_SERVO_LAG_S = 0.1
#: An arm with a load that its gravity compensation does not know sinks while its speeds are told to
#: be 0. After so much of that, s, it holds its position instead. A position servo brakes 1.6 times
#: as hard as a speed servo; the lag at the end of a ramp (0.1 s) has halved by then, so that this
#: is no harder than the ramp. Every moment more costs way.
_SETTLES_S = 0.08
#: Farther from its setpoint a position servo pushes with all that it has, rad: something holds it.
_PUSHES_RAD = 0.1


@final
class Limiter:
    """Makes a plan for every period, and remembers what the last one led to.

    Args:
        bounds: To keep to.
        dynamics: By which torques are limited; None where the robot has none.
        period_s: Between two commands.
        guard: Of what the arm must not touch; None where no model tells.
        observer: Of the load that the arm bears; None where no model tells.

    Attributes:
        scale: Part of the commanded speed at which to go, 0 to 1.
    """

    def __init__(
        self,
        bounds: Bounds,
        dynamics: Dynamics | None,
        period_s: float,
        guard: Guard | None = None,
        observer: LoadObserver | None = None,
    ) -> None:
        self.scale = 1.0
        self._bounds = self._allowed = bounds
        self._dynamics = dynamics
        self._guard = guard
        self._observer = observer
        self._period_s = period_s
        self._kind: CommandKind | None = None
        self._last = np.zeros_like(bounds.lower)
        self._speed = np.zeros_like(bounds.lower)
        self._braking = self._stays = False
        self._stood_s = 0.0

    @property
    def holds(self) -> bool:
        """Whether the last plan leaves the arm at rest."""
        return self._kind is CommandKind.POSITION and not self._speed.any()

    @property
    def is_in_position(self) -> bool:
        """Whether the last plan was of positions; also before there was one."""
        return self._kind in (None, CommandKind.POSITION)

    @property
    def told(self) -> Told | None:
        """What the arm is to follow; None where that is no motion."""
        match self._kind:
            case CommandKind.POSITION:
                return Told(speed=self._speed, position=self._last)
            case CommandKind.VELOCITY:
                return Told(speed=self._last)
            case _:
                return None

    def refusal(self, kind: CommandKind) -> str:
        """Returns why commands of a kind are not taken; empty where they are."""
        if kind is CommandKind.EFFORT and self._dynamics is None:
            return "effort commands need a robot with dynamics to limit them by; it has none"
        return "" if kind is CommandKind.POSITION else self.excess()

    def excess(self) -> str:
        """Returns why only positions are taken: a load; empty where it is not too heavy."""
        observer, bounds = self._observer, self._bounds
        heavy = observer is not None and observer.too_heavy(bounds)
        return f"{self.load_words()}; tell it, or take that off" if heavy else ""

    def load_words(self) -> str:
        """Returns what load the arm bears; empty where nothing observes that."""
        return "" if self._observer is None else self._observer.words(self._bounds)

    def limited(self, command: Command, seen: Observation) -> Plan:
        """Returns what to apply of a command.

        Args:
            command: Finite, in the order of the joints.
            seen: The newest report.
        """
        self._allowed = self._bounds.within(command.speed_share)
        if self.scale == 0.0:
            return replace(self._at_standstill(seen), reason=Reason.SCALED)
        if command.kind is CommandKind.POSITION and not self._enters_position(seen):
            return replace(self._brake(seen), reason=Reason.MODE)
        scaled = self.scale if command.kind is CommandKind.VELOCITY else 1.0
        plan = self._guarded(command.kind, scaled * command.values, seen)
        return plan if self.scale == 1.0 else replace(plan, reason=plan.reason | Reason.SCALED)

    def stopped(self, seen: Observation) -> Plan | None:
        """Returns the next part of a stop: a ramp to rest, then holding; None where it holds."""
        if self.holds:
            return None
        if self._stays and self._is_followed(seen):
            return self._slow_down()
        if not self._at_rest(seen.velocity):
            return self._brake(seen)
        self._hold(seen.position)
        return self._plan(CommandKind.POSITION, seen.position[None])

    def forget(self) -> None:
        """Lets the next plan begin at what the arm then does: the last one may not have acted."""
        self._kind = None
        self._braking = False

    def _guarded(self, kind: CommandKind, values: Array, seen: Observation) -> Plan:
        """Returns a plan that the guard lets through: as wanted, or corrected, or a stop.

        The stop is safe: it was looked at before what is in force now was told.
        """
        plan, load = self._towards(kind, values, seen), self._load
        if self._guard is None:
            return self._taken(plan, stays=load is not None and load.stays)
        self._guard.look(seen)
        too_near, stays = self._looked_at(plan, self._guard)
        if not too_near:
            return self._taken(plan, stays)
        reason = plan.reason | too_near
        sinking = None
        if load is not None and kind is CommandKind.VELOCITY:
            sinking = load.sinking
        speed = self._guard.corrected(self._speed_of(plan, seen), sinking)
        nearly = self._towards(kind, self._values_of(kind, speed, seen), seen)
        too_near, stays = self._looked_at(nearly, self._guard)
        if not too_near:
            return replace(self._taken(nearly, stays), reason=reason)
        return replace(self._at_standstill(seen), reason=reason)

    def _looked_at(self, plan: Plan, guard: Guard) -> tuple[Reason, bool]:
        """Returns why a plan is not to be told, and whether positions are stopped as positions.

        A stop by speeds is quicker, but under a load an arm sinks meanwhile. Where that would bring
        it too near, the stop that is looked at, and made, is one as positions.
        """
        load = self._load
        if plan.kind is not CommandKind.POSITION:
            return guard.reason(plan, load), False
        speed = (plan.values[-1] - self._last) / self._period_s
        stays = load is not None and load.stays
        reason = guard.reason(plan, load, speed if stays else None)
        if stays or Reason.LOAD not in reason:
            return reason, stays
        return guard.reason(plan, load, speed), True

    def _towards(self, kind: CommandKind, values: Array, seen: Observation) -> Plan:
        match kind:
            case CommandKind.POSITION:
                return self._to_position(values)
            case CommandKind.VELOCITY:
                return self._to_speed(values, seen)
            case CommandKind.EFFORT:
                return self._to_torque(values, seen)

    def _taken(self, plan: Plan, stays: bool) -> Plan:
        """Takes note of a plan that is told, and of how it would be stopped."""
        last = plan.values[-1]
        if plan.kind is CommandKind.POSITION:
            self._speed = (last - self._last) / self._period_s
        self._kind, self._last, self._braking, self._stays = plan.kind, last, False, stays
        return plan

    def _speed_of(self, plan: Plan, seen: Observation) -> Array:
        """Returns the speed that a plan leads to, rad/s, shape (J,)."""
        last = plan.values[-1]
        match plan.kind:
            case CommandKind.POSITION:
                return np.asarray((last - self._last) / self._period_s)
            case CommandKind.VELOCITY:
                return np.asarray(last)
            case CommandKind.EFFORT:
                caused = self._moved.accelerations(seen.position, seen.velocity, last)
                return np.asarray(seen.velocity + caused * self._bounds.patience_s)

    def _values_of(self, kind: CommandKind, speed: Array, seen: Observation) -> Array:
        """Returns the command of a kind that leads to a speed."""
        match kind:
            case CommandKind.POSITION:
                return np.asarray(self._last + speed * self._period_s)
            case CommandKind.VELOCITY:
                return speed
            case CommandKind.EFFORT:
                needed = (speed - seen.velocity) / self._bounds.patience_s
                return self._moved.torques(seen.position, seen.velocity, needed)

    def _at_standstill(self, seen: Observation) -> Plan:
        """Returns the next part of a stop, or of holding after it."""
        return self.stopped(seen) or self._plan(CommandKind.POSITION, self._last[None])

    @property
    def _known(self) -> Dynamics:
        if self._dynamics is None:
            raise AssertionError("refusal() comes first")
        return self._dynamics

    @property
    def _moved(self) -> Dynamics:
        """The arm as it moves, with its load."""
        load = self._load
        return self._known if load is None else Loaded(self._known, load.torque)

    @property
    def _load(self) -> Load | None:
        return None if self._observer is None else self._observer.load

    def _scaled(self, bounds: Bounds) -> Bounds:
        return replace(bounds, velocity=self.scale * bounds.velocity)

    def _enters_position(self, seen: Observation) -> bool:
        """Returns whether positions may be told; the first one begins where the arm rests."""
        if self._kind is CommandKind.POSITION:
            return True
        if not self._at_rest(seen.velocity):
            return False
        self._hold(seen.position)
        return True

    def _at_rest(self, velocity: Array) -> bool:
        if self._kind is CommandKind.VELOCITY and self._last.any():
            return False
        still = bool((np.abs(velocity) < self._bounds.still).all())
        return still or (self._braking and self._stood_s > _SETTLES_S)

    def _hold(self, position: Array) -> None:
        self._kind, self._braking = CommandKind.POSITION, False
        self._last, self._speed = position.copy(), np.zeros_like(position)

    def _brake(self, seen: Observation) -> Plan:
        """Returns the next part of a ramp to rest.

        It begins at the speed that the arm has, or at the one that it was told where that is less:
        an arm that a load drags along shall not be told to go with it.
        """
        if not self._braking:
            self._last, self._stood_s = smaller(self._told_speed(seen), seen.velocity), 0.0
        self._stood_s = 0.0 if self._last.any() else self._stood_s + self._period_s
        self._kind, self._braking = CommandKind.VELOCITY, True
        step = self._bounds.braking * self._period_s
        slower = self._last - np.clip(self._last, -step, step)
        values = speeds(self._last, slower, self._bounds.braking, self._period_s)
        self._last = slower
        return self._plan(CommandKind.VELOCITY, values)

    def _is_followed(self, seen: Observation) -> bool:
        """Returns whether the arm is about where positions were told, and is not held up."""
        if self._kind is not CommandKind.POSITION:
            return False
        late = np.abs(self._last - seen.position) - LAG_S * np.abs(self._speed)
        return bool((late < _PUSHES_RAD).all())

    def _slow_down(self) -> Plan:
        """Returns the next positions of a way to rest: at speeds of 0 a loaded arm would sink."""
        step = self._bounds.acceleration * self._period_s
        slower = self._speed - np.clip(self._speed, -step, step)
        after = self._last + slower * self._period_s
        values, spacing_s = positions(self._last, after, self._period_s)
        self._last, self._speed = after, slower
        return Plan(kind=CommandKind.POSITION, values=values, spacing_s=spacing_s)

    def _to_position(self, wanted: Array) -> Plan:
        after, reason = limited_position(
            wanted,
            self._last,
            self._speed,
            self._scaled(self._allowed),
            period_s=self._period_s,
        )
        values, spacing_s = positions(self._last, after, self._period_s)
        return Plan(kind=CommandKind.POSITION, values=values, spacing_s=spacing_s, reason=reason)

    def _to_speed(self, wanted: Array, seen: Observation) -> Plan:
        last = self._told_speed(seen)
        limited = partial(
            limited_speed,
            position=seen.position,
            period_s=self._period_s,
            after_s=self._bounds.patience_s + _SERVO_LAG_S,
        )
        after, reason = limited(wanted, last, bounds=self._allowed)
        for sinks in [] if self._load is None else self._load.lately:
            # The arm goes by so much more than it is told. That is kept to what the bridge allows,
            # not to the task's share: speeds against it, which may be friction, would exceed that.
            loaded, why = limited(after + sinks, last + sinks, bounds=self._bounds)
            after, reason = loaded - sinks, reason | by_load(why)
        values = speeds(last, after, self._bounds.acceleration, self._period_s)
        return self._plan(CommandKind.VELOCITY, values, reason)

    def _told_speed(self, seen: Observation) -> Array:
        """Returns the speeds that the arm was told, or those by which it would go on as it does."""
        if self._kind is CommandKind.VELOCITY:
            return self._last
        return seen.velocity if self._load is None else seen.velocity - self._load.sinking

    def _to_torque(self, wanted: Array, seen: Observation) -> Plan:
        at = seen.position, seen.velocity
        torque, reason = limited_torque(wanted, *at, self._known, self._scaled(self._allowed))
        if self._load is not None:
            torque, why = limited_torque(torque, *at, self._moved, self._scaled(self._bounds))
            reason |= by_load(why)
        return self._plan(CommandKind.EFFORT, torque[None], reason)

    def _plan(self, kind: CommandKind, values: Array, reason: Reason = Reason.NONE) -> Plan:
        return Plan(kind=kind, values=values, spacing_s=SPACING_S, reason=reason)
