"""What a person has the robot do beside moving: told again and again until its state follows."""

from __future__ import annotations

from typing import final

from gfm.core import RefusedError
from gfm_robot_bridge.intera.assembly import Assembly, Button
from gfm_robot_bridge.intera.topics import ENABLE, RESET, STOP, Topic
from gfm_wire import PowerAction

#: As the manufacturer's own client does it.
_LONGEST_NS = 5_000_000_000
_AGAIN_NS = 100_000_000
_TOLD = {
    PowerAction.ENABLE: (ENABLE, {"data": True}),
    PowerAction.DISABLE: (ENABLE, {"data": False}),
    PowerAction.STOP: (STOP, {}),
    PowerAction.RESET: (RESET, {}),
}


def refusal(action: PowerAction, state: Assembly) -> str:
    """Returns why it makes no sense now, in words; empty where it does."""
    if action is PowerAction.ENABLE and not state.is_clear:
        return f"it is not enabled while {state.fault()}"
    if action is not PowerAction.RESET:
        return ""
    if state.button is Button.PRESSED:
        return "its e-stop button is pressed: release it first"
    return "" if state.stopped or state.error else "there is nothing to reset"


def is_done(action: PowerAction, state: Assembly) -> bool:
    """Returns whether the state has followed."""
    match action:
        case PowerAction.ENABLE:
            return state.enabled
        case PowerAction.DISABLE:
            return not state.enabled
        case PowerAction.STOP:
            return state.stopped
        case PowerAction.RESET:
            return state.is_clear


@final
class Switching:
    """One action under way.

    Args:
        action: What is asked for.
        state: Of the robot now.
        now_ns: On this process's clock.

    Raises:
        RefusedError: it makes no sense now.
    """

    def __init__(self, action: PowerAction, state: Assembly, now_ns: int) -> None:
        if problem := refusal(action, state):
            raise RefusedError(f"robot: {problem}")
        self._action = action
        self._began_ns = now_ns
        self._again_ns = now_ns
        self._over = False

    def is_done(self, state: Assembly, now_ns: int) -> bool:
        """Returns whether the robot's state has followed.

        Raises:
            RefusedError: it has not for too long.
        """
        if self._is_over(state, now_ns) and is_done(self._action, state):
            return True
        if self._over:
            raise RefusedError(
                f"robot: {self._action} did nothing within {_LONGEST_NS * 1e-9:g} s: "
                f"{state.fault() or 'it is enabled'}"
            )
        return False

    def due(self, state: Assembly, now_ns: int) -> tuple[Topic, dict[str, bool]] | None:
        """Returns what to publish now; None where it was told a moment ago, or it is over."""
        if self._is_over(state, now_ns) or now_ns < self._again_ns:
            return None
        self._again_ns = now_ns + _AGAIN_NS
        return _TOLD[self._action]

    def _is_over(self, state: Assembly, now_ns: int) -> bool:
        """Returns whether it was done or given up; it stays so, whatever the state becomes."""
        late = now_ns - self._began_ns > _LONGEST_NS
        self._over = self._over or late or is_done(self._action, state)
        return self._over
