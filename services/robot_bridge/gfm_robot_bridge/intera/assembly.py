"""The state of the robot as a whole: whether it can be driven, and if not, what has to be done."""

from __future__ import annotations

from enum import IntEnum

import msgspec


class Button(IntEnum):
    """The e-stop button."""

    UNPRESSED = 0
    PRESSED = 1
    UNKNOWN = 2
    RELEASED = 3
    """It was pressed; the robot is stopped still."""


class Source(IntEnum):
    """What stopped the robot."""

    NONE = 0
    USER = 1
    UNKNOWN = 2
    FAULT = 3
    ENGINE = 4


_SOURCES = {
    Source.NONE: "it does not say why",
    Source.USER: "by its e-stop button",
    Source.UNKNOWN: "by software, or for an unknown reason",
    Source.FAULT: "for a fault of a joint",
    Source.ENGINE: "by its engine",
}


class Assembly(msgspec.Struct, frozen=True, kw_only=True):
    """What the robot says of itself; it has no stamp.

    Attributes:
        homed: Whether the joints know where they are.
        ready: Whether it could be driven, as while it is not homing.
        enabled: Whether the drives have power.
        stopped: Whether an e-stop is asserted.
        error: Whether a part of it has an error.
        low_voltage: Whether it is in low voltage mode.
        button: The e-stop button.
        source: What stopped it.
    """

    homed: bool
    ready: bool
    enabled: bool
    stopped: bool
    error: bool
    low_voltage: bool = msgspec.field(name="lowVoltage")
    button: Button = msgspec.field(name="estop_button")
    source: Source = msgspec.field(name="estop_source")

    @property
    def is_clear(self) -> bool:
        """Whether nothing is left that a reset would clear."""
        stop = self.button is not Button.UNPRESSED or self.source is not Source.NONE
        return not (self.stopped or self.error or stop)

    def fault(self) -> str:
        """Returns why it does not move whatever it is told, in words; empty where it does."""
        if self.button is Button.PRESSED:
            return "its e-stop button is pressed: release it, then `gfm robot reset`"
        if self.stopped:
            return f"it is stopped {_SOURCES[self.source]}: `gfm robot reset`, then `enable`"
        if self.error:
            return "a part of it has an error: `gfm robot reset`, or see to it"
        if self.low_voltage:
            return "it is in low voltage mode"
        if not self.homed:
            return "its joints are not homed"
        if not self.enabled:
            return "it is not enabled: `gfm robot enable`"
        return "" if self.ready else "it is not ready: it homes, or starts"
