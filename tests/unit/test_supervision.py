"""What a keeper decides about processes that die or hang: with a clock and children of its own."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from itertools import pairwise

import pytest

from gfm.core import ConfigError, Status
from gfm.launch.keeper import cause, status_of
from gfm.launch.policy import (
    Action,
    Life,
    decide,
    died,
    is_given_up,
    looked,
    lost,
    started,
    told_to_stop,
    trouble,
)
from gfm.launch.process import LOGS_KEPT, set_aside
from gfm.launch.supervision import DEADLINES_S, SupervisionConfig
from gfm.launch.survey import Missing, missing_of, status_table, summary, summary_line
from gfm.service import read_config

CONFIG = SupervisionConfig()


def up(role: str) -> Life:
    return Life(role=role, since_s=0.0, beats=True)


def system(**changed: Life) -> dict[str, Life]:
    roles = {"router": "router", "replay": "replay", "learner": "learner"}
    roles |= {"actor_0": "actor", "actor_1": "actor"}
    return {name: up(role) for name, role in roles.items()} | changed


@dataclass
class FakeSystem:
    """Children that are told what `decide` says, once a second; a cause makes one die or hang."""

    lives: dict[str, Life]
    config: SupervisionConfig = CONFIG
    dies_after_s: dict[str, float] = field(default_factory=dict)
    silent: set[str] = field(default_factory=set)
    deaf: set[str] = field(default_factory=set)
    now_s: float = 0.0
    told: list[tuple[float, str, Action]] = field(default_factory=list)

    def run(self, seconds: float, step_s: float = 1.0) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += step_s
            self._look(step_s)
            for name, action in decide(self.now_s, self.lives, self.config).items():
                self.told.append((self.now_s, name, action))
                self._obey(name, action)

    def _look(self, step_s: float) -> None:
        for name, life in self.lives.items():
            after_s = self.dies_after_s.get(name)
            if life.running and after_s is not None and self.now_s - life.since_s >= after_s:
                self._die(name, "ended with status 1")
        beaten = {name for name, life in self.lives.items() if life.running} - self.silent
        self.lives = looked(self.lives, beaten, step_s)

    def _obey(self, name: str, action: Action) -> None:
        if action is Action.START:
            self.silent.discard(name)
            self.lives[name] = started(self.lives[name], self.now_s)
        elif action is Action.STOP:
            self.lives[name] = told_to_stop(self.lives[name], self.now_s)
            if name not in self.deaf:
                self._die(name, "ended with status 0")
        else:
            self._die(name, "ended with status -9")

    def _die(self, name: str, why: str) -> None:
        self.lives[name] = died(self.lives[name], self.now_s, why, self.config)

    def times_of(self, name: str, action: Action) -> list[float]:
        return [at_s for at_s, who, what in self.told if (who, what) == (name, action)]


def test_a_healthy_system_is_left_alone():
    fake = FakeSystem(system())
    fake.run(1000.0)
    assert fake.told == []
    assert all(trouble(1000.0, life, CONFIG) == "" for life in fake.lives.values())


def test_one_death_costs_one_short_pause():
    fake = FakeSystem(system())
    fake._die("replay", "ended with status -9")
    fake.run(5.0, step_s=0.25)
    assert fake.told == [(0.5, "replay", Action.START)]
    assert fake.lives["replay"].is_up


def test_pauses_double_from_death_to_death_up_to_a_bound_and_end_with_giving_up():
    fake = FakeSystem(system(), dies_after_s={"actor_0": 1.0})
    fake.run(1000.0, step_s=0.5)
    starts_s = fake.times_of("actor_0", Action.START)
    pauses_s = [after_s - before_s for before_s, after_s in pairwise(starts_s)]
    assert pauses_s == [1.0 + pause_s for pause_s in (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)]
    life = fake.lives["actor_0"]
    assert (life.deaths, life.starts) == (8, 8)
    assert is_given_up(life, CONFIG)
    assert trouble(fake.now_s, life, CONFIG).endswith(
        "after 8 deaths in 600 s: ended with status 1"
    )


def test_deaths_that_are_long_ago_do_not_count():
    fake = FakeSystem(system(), dies_after_s={"actor_0": 100.0})
    fake.run(5000.0)
    life = fake.lives["actor_0"]
    assert life.deaths > CONFIG.most_deaths
    assert len(life.deaths_s) < CONFIG.most_deaths
    assert not is_given_up(life, CONFIG)


@pytest.mark.parametrize("role", sorted(DEADLINES_S))
def test_silence_is_stopped_at_the_role_s_own_deadline(role):
    name = role if role in system() else f"{role}_0"
    fake = FakeSystem(system(**{name: up(role)}), silent={name})
    fake.run(DEADLINES_S[role] + 5.0)
    assert fake.times_of(name, Action.STOP) == [DEADLINES_S[role]]
    assert fake.times_of(name, Action.KILL) == []
    assert fake.lives[name].is_up
    assert (fake.lives[name].hangs, fake.lives[name].deaths) == (1, 1)


def test_what_does_not_stop_is_killed_after_its_grace():
    fake = FakeSystem(system(), silent={"replay"}, deaf={"replay"})
    fake.run(60.0)
    assert [(at_s, action) for at_s, _, action in fake.told] == [
        (30.0, Action.STOP),
        (30.0 + CONFIG.stop_s, Action.KILL),
        (31.0 + CONFIG.stop_s, Action.START),
    ]
    assert fake.lives["replay"].why == "hung: no beat for 40 s"


def test_a_deadline_of_the_settings_wins_over_the_default():
    config = SupervisionConfig(deadline_s={"learner": 7.0})
    fake = FakeSystem(system(), config=config, silent={"learner", "actor_0"})
    fake.run(20.0)
    assert [told[:2] for told in fake.told if told[2] is Action.STOP] == [(7.0, "learner")]


def test_an_actor_is_started_only_when_the_learner_it_asks_is_up():
    down = died(up("learner"), 0.0, "ended with status 1", CONFIG)
    fake = FakeSystem(system(learner=replace(down, hopeless=True)))
    fake._die("actor_0", "ended with status 1")
    fake.run(100.0)
    assert fake.told == []
    fake.lives["learner"] = up("learner")
    fake.run(1.0)
    assert [told[1:] for told in fake.told] == [("actor_0", Action.START)]


def test_who_waits_for_another_to_begin_is_not_silent_meanwhile():
    begun = Life(role="actor", since_s=0.0)
    fake = FakeSystem(system(actor_0=begun), silent={"actor_0"})
    fake.lives["learner"] = replace(up("learner"), running=False, hopeless=True)
    fake.run(CONFIG.start_s + 10.0)
    assert fake.told == []
    fake.lives["learner"] = up("learner")
    fake.run(CONFIG.start_s + 1.0)
    assert fake.times_of("actor_0", Action.STOP)


def test_what_never_beats_is_stopped_after_the_time_for_a_start():
    fake = FakeSystem(system(learner=Life(role="learner", since_s=0.0)), silent={"learner"})
    fake.run(CONFIG.start_s)
    assert fake.times_of("learner", Action.STOP) == [CONFIG.start_s]


def test_bad_input_is_given_up_at_once():
    life = died(up("replay"), 1.0, "ended with status 2: error: no", CONFIG, hopeless=True)
    assert is_given_up(life, CONFIG)
    assert trouble(5.0, life, CONFIG) == "given up 4 s ago: ended with status 2: error: no"


def test_the_system_is_lost_with_the_last_of_a_role():
    gone = died(up("actor"), 0.0, "ended with status 2", CONFIG, hopeless=True)
    assert lost(system(actor_0=gone), CONFIG) is None
    assert lost(system(actor_0=gone, actor_1=gone), CONFIG) == "actor_0"
    assert lost(system(replay=replace(gone, role="replay")), CONFIG) == "replay"


def test_trouble_is_told_from_the_first_quarter_of_a_deadline_on():
    silent = replace(up("replay"), silent_s=7.4)
    assert trouble(9.0, silent, CONFIG) == ""
    silent = replace(silent, silent_s=7.5)
    assert trouble(9.0, silent, CONFIG) == "no beat for 8 s, is stopped after 30 s"
    told = told_to_stop(replace(silent, silent_s=30.0), 31.0)
    assert trouble(31.0, told, CONFIG) == "hangs: no beat for 30 s, limit 30 s; told to stop"
    down = died(told, 33.0, "ended with status -9", CONFIG)
    assert trouble(35.0, down, CONFIG).startswith("down for 2 s: hung: no beat for 30 s; will be")
    again = started(down, 36.0)
    assert trouble(38.0, again, CONFIG) == "starting for 2 s, after it hung: no beat for 30 s"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[deadline_s]\ncook = 3.0", "deadline_s has cook, expected router, replay"),
        ("longest_pause_s = 0.1", "longest_pause_s is 0.1 and first_pause_s is 0.5, expected at"),
        ("most_deaths = 0", r"Expected `int` >= 1 - at `\$.most_deaths`"),
        ("[deadline_s]\nactor = -1.0", r"Expected `float` > 0.0 - at `\$.deadline_s"),
        ("stop = 1.0", "Object contains unknown field `stop`"),
    ],
)
def test_settings_that_cannot_be_are_refused(tmp_path, text, message):
    path = tmp_path / "supervisor.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_config(SupervisionConfig, path, {})


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (0, "ended with status 0"),
        (1, "ended with status 1: error: no answer from replay"),
        (-9, "ended by signal 9 (Killed)"),
    ],
)
def test_an_end_is_told_by_its_signal_or_by_the_last_line_of_an_error(status, words):
    assert cause(status, ["connected", "error: no answer from replay"]) == words


def answered(role: str, name: str) -> Status:
    return Status(role=role, name=name, pid=1, host="h")


def test_who_should_be_there_and_is_not_is_told_with_since_when_and_why():
    down = died(up("actor"), 10.0, "ended with status -9", CONFIG)
    kept = [
        status_of("actor_0", 7, down, 13.0, CONFIG),
        status_of("learner", 8, up("learner"), 13.0, CONFIG),
        status_of("replay", 9, up("replay"), 13.0, CONFIG),
    ]
    assert [status.pid for status in kept] == [0, 8, 9]
    assert kept[0].counters == {"starts": 1, "deaths": 1, "hangs": 0}
    missing = missing_of([answered("learner", "learner")], kept)
    assert missing == [
        Missing(
            role="actor",
            name="actor_0",
            since_s=3.0,
            why="down for 3 s: ended with status -9; will be started again",
        ),
        Missing(role="replay", name="replay", since_s=13.0, why="runs, but does not answer"),
    ]
    sums = json.loads(json.dumps(summary([], missing)))
    assert sums["missing"][0] == vars(missing[0])
    assert summary_line(sums).endswith("missing actor_0  missing replay")
    assert status_table([], missing).row_count == 2


def test_nobody_is_missing_where_nobody_knows_who_should_be_there():
    assert missing_of([answered("learner", "learner")], []) is None


def test_logs_of_the_dead_are_numbered_and_the_oldest_of_many_go(tmp_path):
    log = tmp_path / "actor-1.log"
    set_aside(log)
    (tmp_path / "actor-10.7.log").write_text("of somebody else")
    for life in range(1, LOGS_KEPT + 4):
        log.write_text(f"life {life}")
        set_aside(log)
    kept = {path.name: path.read_text() for path in tmp_path.glob("actor-1.*.log")}
    assert kept == {f"actor-1.{n}.log": f"life {n}" for n in range(4, LOGS_KEPT + 4)}
    assert not log.exists()
    assert (tmp_path / "actor-10.7.log").exists()
