"""A film in a report: the robot as measured, and as both models move it."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass

from markupsafe import Markup


@dataclass(frozen=True, kw_only=True)
class Film:
    """A film, or the reason why there is none.

    Attributes:
        mp4: H.264, 15 pictures a second; empty where there is none.
        recording: Whose motion is shown.
        length_s: Recorded time that is shown.
        slowed: How many times slower than the robot was.
        enlarged: How many times as large as they are differences from the measured robot are drawn.
        anew_s: Recorded time after which the models begin anew as measured.
        missing: In one line; empty where there is a film.
    """

    mp4: bytes = b""
    recording: str = ""
    length_s: float = 0.0
    slowed: int = 1
    enlarged: int = 1
    anew_s: float = float("inf")
    missing: str = ""

    @property
    def address(self) -> str:
        """The film as an address that needs no file."""
        return f"data:video/mp4;base64,{b64encode(self.mp4).decode()}"

    @property
    def caption(self) -> str:
        """What is seen, in words."""
        speed = "in real time" if self.slowed == 1 else f"{self.slowed} times slower than it was"
        told = [
            f"The {self.length_s:.1f} s of {self.recording} in which the nominal model is furthest "
            f"off, {speed}. The models get only the recorded commands; all is drawn in the nominal "
            "model's shapes."
        ]
        if self.length_s > self.anew_s:
            told.append(f"The models start again as measured every {self.anew_s:g} s.")
        if self.enlarged > 1:
            told.append(f"Differences are drawn {self.enlarged} times as large as they are.")
        return " ".join(told)

    def _repr_html_(self) -> str:
        if not self.mp4:
            return Markup("<p>{}</p>").format(self.missing)
        return Markup(
            '<video src="{}" controls autoplay muted loop playsinline></video><p>{}</p>'
        ).format(self.address, self.caption)
