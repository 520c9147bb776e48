"""What to do about processes that died or hang: decided from values, done by the keeper.

A process that ends is started again after a pause that doubles with every recent death. One that
does not beat for its deadline is stopped, then killed, and counts as dead. One that died too often
is given up: it would die again, and somebody has to look.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto

from gfm.launch.supervision import DEADLINES_S, SupervisionConfig

NEEDS: Mapping[str, tuple[str, ...]] = {
    "router": (),
    "replay": ("router",),
    "learner": ("router",),
    "robot": ("router",),
    "robot_bridge": ("router",),
    "actor": ("router", "learner"),
}
"""Whom a process needs before it can begin: an actor asks the learner what it shall do."""

_LATE = 0.25
"""Part of its deadline after which a silent process is spoken of."""


@dataclass(frozen=True, kw_only=True)
class Life:
    """What is known of a process that should be there. Times are of one monotonic clock.

    Attributes:
        role: One of START_ORDER.
        since_s: When it was started or, where it does not run, when it ended.
        running: Whether it runs.
        beats: Whether it has beaten since it was started.
        silent_s: Time without a beat, as far as somebody looked.
        told_s: When it was told to stop because it hung; None: it was not.
        deaths_s: When it died, as far as that still counts.
        hopeless: Whether it refused what it was told: it would again.
        starts: How often it was started.
        deaths: How often it died.
        hangs: How often it was stopped because it hung.
        why: Of its last death, in words.
    """

    role: str
    since_s: float
    running: bool = True
    beats: bool = False
    silent_s: float = 0.0
    told_s: float | None = None
    deaths_s: tuple[float, ...] = ()
    hopeless: bool = False
    starts: int = 1
    deaths: int = 0
    hangs: int = 0
    why: str = ""

    @property
    def is_up(self) -> bool:
        """Whether others may count on it."""
        return self.running and self.beats


class Action(Enum):
    """What can be done about a process."""

    START = auto()
    STOP = auto()
    KILL = auto()


def looked(lives: Mapping[str, Life], beaten: Collection[str], passed_s: float) -> dict[str, Life]:
    """Returns what is known after a look at everybody.

    Args:
        lives: What was known, by name.
        beaten: Who has beaten since the look before.
        passed_s: Time since then. Who waits for another one to begin is not silent meanwhile.
    """

    def after(name: str, life: Life) -> Life:
        if not life.running:
            return life
        if name in beaten:
            return replace(life, beats=True, silent_s=0.0)
        waits = not life.beats and not may_begin(life, lives.values())
        return life if waits else replace(life, silent_s=life.silent_s + passed_s)

    return {name: after(name, life) for name, life in lives.items()}


def told_to_stop(life: Life, now_s: float) -> Life:
    """Returns what is known after a process that hangs was told to stop."""
    return replace(life, told_s=now_s, hangs=life.hangs + 1)


def died(
    life: Life, now_s: float, why: str, config: SupervisionConfig, *, hopeless: bool = False
) -> Life:
    """Returns what is known after the end of a process, which nobody had asked for."""
    if life.told_s is not None:
        why = f"hung: no beat for {life.silent_s:.0f} s"
    recent = (*(at_s for at_s in life.deaths_s if now_s - at_s < config.within_s), now_s)
    return replace(
        life,
        running=False,
        since_s=now_s,
        deaths_s=recent,
        deaths=life.deaths + 1,
        hopeless=hopeless,
        why=why,
    )


def started(life: Life, now_s: float) -> Life:
    """Returns what is known after a process was started again."""
    return replace(
        life,
        running=True,
        since_s=now_s,
        beats=False,
        silent_s=0.0,
        told_s=None,
        starts=life.starts + 1,
    )


def limit_s(life: Life, config: SupervisionConfig) -> float:
    """Returns for how long a process may be silent."""
    if not life.beats:
        return config.start_s
    return config.deadline_s.get(life.role, DEADLINES_S[life.role])


def is_given_up(life: Life, config: SupervisionConfig) -> bool:
    """Returns whether a process is not started any more."""
    return not life.running and (life.hopeless or len(life.deaths_s) >= config.most_deaths)


def may_begin(life: Life, lives: Iterable[Life]) -> bool:
    """Returns whether those whom a process needs are up, as far as the system has such."""
    others = list(lives)
    return all(
        any(other.is_up for other in others if other.role == role)
        for role in NEEDS[life.role]
        if any(other.role == role for other in others)
    )


def decide(now_s: float, lives: Mapping[str, Life], config: SupervisionConfig) -> dict[str, Action]:
    """Returns what to do now, by the names of those to do it to."""
    actions = {
        name: _action(now_s, life, may_begin(life, lives.values()), config)
        for name, life in lives.items()
    }
    return {name: action for name, action in actions.items() if action is not None}


def _action(
    now_s: float, life: Life, needs_are_up: bool, config: SupervisionConfig
) -> Action | None:
    if not life.running:
        waited = now_s - life.since_s >= config.pause_s(len(life.deaths_s))
        ready = waited and needs_are_up and not is_given_up(life, config)
        return Action.START if ready else None
    if life.told_s is not None:
        return Action.KILL if now_s - life.told_s >= config.stop_s else None
    return Action.STOP if life.silent_s >= limit_s(life, config) else None


def lost(lives: Mapping[str, Life], config: SupervisionConfig) -> str | None:
    """Returns one who was given up and was the last of a role, or None: the system cannot go on."""
    for name, life in lives.items():
        mates = [other for other in lives.values() if other.role == life.role]
        if all(is_given_up(mate, config) for mate in mates):
            return name
    return None


def trouble(now_s: float, life: Life, config: SupervisionConfig) -> str:
    """Returns what is wrong with a process, since when and why; empty where all is well."""
    since_s = now_s - life.since_s
    if is_given_up(life, config):
        deaths = len(life.deaths_s)
        often = "" if life.hopeless else f" after {deaths} deaths in {config.within_s:.0f} s"
        return f"given up {since_s:.0f} s ago{often}: {life.why}"
    if not life.running:
        return f"down for {since_s:.0f} s: {life.why}; will be started again"
    most_s = limit_s(life, config)
    if life.told_s is not None:
        return f"hangs: no beat for {life.silent_s:.0f} s, limit {most_s:.0f} s; told to stop"
    if not life.beats:
        after = f", after it {life.why}" if life.why else ""
        return f"starting for {since_s:.0f} s{after}"
    if life.silent_s >= _LATE * most_s:
        return f"no beat for {life.silent_s:.0f} s, is stopped after {most_s:.0f} s"
    return ""
