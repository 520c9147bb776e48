"""What a long run is doing now, and how long it will still take.

On a terminal: a table of the phases that redraws itself. Elsewhere, in a file or a pipe: plain
lines, one for every phase that begins or ends and at most one for every few seconds in between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self, final

from rich import box
from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from gfm.core import Clock, ConfigError, UnknownNameError

# Below this share of a phase, the caller's estimate says more than extrapolation.
_TRUSTED_SHARE = 0.1
_LINE_PERIOD_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One part of the run.

    Attributes:
        name: What it does, in a few words.
        expected_s: How long it should take, seconds.
    """

    name: str
    expected_s: float

    def __post_init__(self) -> None:
        if not self.expected_s >= 0.0:
            raise ConfigError(
                f"phase {self.name!r} is expected to take {self.expected_s} s; expected at least 0"
            )


@dataclass(frozen=True, kw_only=True)
class PhaseState:
    """How far a phase has come.

    Attributes:
        phase: Which.
        started_s: When it began, on the run's time; None before that.
        ended_s: When it ended; None before that.
        share: Done so far, 0..1; 0 where nobody says.
        now: What is happening, in words.
    """

    phase: Phase
    started_s: float | None = None
    ended_s: float | None = None
    share: float = 0.0
    now: str = ""

    @property
    def running(self) -> bool:
        """Whether it has begun and not ended."""
        return self.started_s is not None and self.ended_s is None

    def elapsed_s(self, time_s: float) -> float:
        """Returns how long it has taken at `time_s` of the run, seconds."""
        if self.started_s is None:
            return 0.0
        return (time_s if self.ended_s is None else self.ended_s) - self.started_s

    def left_s(self, time_s: float) -> float:
        """Returns how long it will still take, seconds.

        The caller's estimate until a part of the phase is done, then what that part took,
        extrapolated. 0 for a phase that takes longer than expected and does not say how far it is.
        """
        if self.ended_s is not None:
            return 0.0
        elapsed_s = self.elapsed_s(time_s)
        if self.share >= _TRUSTED_SHARE:
            return elapsed_s * (1.0 - self.share) / self.share
        return max(0.0, self.phase.expected_s - elapsed_s)

    def shown_share(self, time_s: float) -> float:
        """Returns the share done, 0..1, by time where nobody says."""
        if self.ended_s is not None:
            return 1.0
        elapsed_s = self.elapsed_s(time_s)
        whole_s = elapsed_s + self.left_s(time_s)
        # What overruns its estimate is not done yet.
        return min(0.99, elapsed_s / whole_s) if whole_s > 0.0 else 0.0


@final
class RunProgress:
    """The progress of one run: enter it, then enter its phases one after the other.

    ```python
    with RunProgress(phases, console=console, clock=clock) as progress:
        with progress.phase("record"):
            progress.say("waypoint trajectory 2 of 4", share=0.25)
    ```
    """

    def __init__(self, phases: Sequence[Phase], *, console: Console, clock: Clock) -> None:
        """Makes a display that is not shown yet.

        Args:
            phases: In the order in which they will run; a phase may be left out later.
            console: Where it is shown; lines instead of a table where it is no terminal.
            clock: Tells the time of the run.
        """
        self._states = {phase.name: PhaseState(phase=phase) for phase in phases}
        self._console = console
        self._clock = clock
        self._start_ns = clock.now_ns()
        self._last_line_s = -_LINE_PERIOD_S
        self._drawn = console.is_terminal and not console.is_dumb_terminal
        self._spinner = Spinner("dots")
        self._live = Live(self, console=console, refresh_per_second=4, transient=False)

    def __enter__(self) -> Self:
        self._start_ns = self._clock.now_ns()
        if self._drawn:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._drawn:
            self._live.stop()
        elif kind is None:
            self._print(f"done after {clock_face(self.time_s)}")

    @property
    def time_s(self) -> float:
        """Seconds since the run began."""
        return (self._clock.now_ns() - self._start_ns) * 1e-9

    @property
    def states(self) -> tuple[PhaseState, ...]:
        """How far every phase has come, in their order."""
        return tuple(self._states.values())

    @property
    def left_s(self) -> float:
        """How long the run will still take, seconds; phases that were passed over count nothing."""
        begun = [index for index, one in enumerate(self.states) if one.started_s is not None]
        ahead = self.states[begun[-1] if begun else 0 :]
        return sum(one.left_s(self.time_s) for one in ahead)

    @property
    def _running(self) -> PhaseState | None:
        return next((one for one in self.states if one.running), None)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Runs the block as the phase of this name."""
        state = self._named(name)
        self._states[name] = replace(state, started_s=self.time_s, ended_s=None, share=0.0, now="")
        self._begin_line(name)
        yield
        self._states[name] = replace(self._states[name], ended_s=self.time_s, now="")
        took = clock_face(self._states[name].elapsed_s(self.time_s))
        self._print(f"{name}: done in {took}")

    def say(self, now: str, *, share: float | None = None) -> None:
        """Says what is happening in the running phase, and which share of it is done (0..1)."""
        running = self._running
        if running is None:
            return
        known = running.share if share is None else min(max(share, 0.0), 1.0)
        running = replace(running, now=now, share=known)
        self._states[running.phase.name] = running
        if self.time_s - self._last_line_s >= _LINE_PERIOD_S:
            self._print(f"{running.phase.name}: {now} (left: {self._left_words(running)})")

    def expect(self, name: str, expected_s: float) -> None:
        """Replaces the estimate of a phase by a better one."""
        state = self._named(name)
        self._states[name] = replace(state, phase=replace(state.phase, expected_s=expected_s))

    def durations_s(self) -> dict[str, float]:
        """Returns how long each finished phase took, in their order."""
        finished = (one for one in self.states if one.ended_s is not None)
        return {one.phase.name: one.elapsed_s(self.time_s) for one in finished}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draws the table of phases as of now, and below it what is happening."""
        time_s = self.time_s
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
        table.add_column("", width=1)
        table.add_column("phase", overflow="fold", min_width=24)
        table.add_column("", width=12)
        table.add_column("took", justify="right", no_wrap=True, min_width=5)
        table.add_column("left", justify="right", no_wrap=True, min_width=5)
        for state in self.states:
            table.add_row(*self._row(state, time_s), style="bold" if state.running else None)
        yield table
        running = self._running
        now = running.now if running is not None else ""
        yield Text(f"  {now}", overflow="ellipsis", no_wrap=True)
        yield Text(f"  {clock_face(time_s)} so far, about {clock_face(self.left_s)} left", "bold")

    def _row(self, state: PhaseState, time_s: float) -> Iterator[Text | ProgressBar | Spinner]:
        share = state.shown_share(time_s)
        yield self._spinner if state.running else Text("✓" if share == 1.0 else "·", "green")
        yield Text(state.phase.name)
        yield ProgressBar(total=1.0, completed=share, width=12)
        yield Text(clock_face(state.elapsed_s(time_s)) if state.started_s is not None else "")
        yield Text("" if share == 1.0 else _left_face(state, time_s))

    def _named(self, name: str) -> PhaseState:
        if name not in self._states:
            raise UnknownNameError("phase", name, self._states)
        return self._states[name]

    def _begin_line(self, name: str) -> None:
        place = list(self._states).index(name) + 1
        state = self._states[name]
        self._print(f"{place}/{len(self._states)} {name} (left: {self._left_words(state)})")

    def _left_words(self, state: PhaseState) -> str:
        return f"{_left_face(state, self.time_s)}, whole run {clock_face(self.left_s)}"

    def _print(self, line: str) -> None:
        if self._drawn:
            return
        self._last_line_s = self.time_s
        text = Text(f"[{clock_face(self.time_s):>6}] {line}")
        # A log line is one line, however narrow the console that nobody looks at.
        self._console.print(text, soft_wrap=True)


def clock_face(seconds: float) -> str:
    """Returns "1:05", or "1:02:05" from one hour on."""
    minutes, rest = divmod(round(max(0.0, seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _left_face(state: PhaseState, time_s: float) -> str:
    left_s = state.left_s(time_s)
    overran = state.running and left_s == 0.0
    return "soon" if overran else clock_face(left_s)
