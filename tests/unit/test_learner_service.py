"""The learner service: what it asks, sends, keeps and refuses."""

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tensorboard.backend.event_processing.event_file_loader import EventFileLoader

from gfm.core import (
    BadInputError,
    Batch,
    ConfigError,
    EnvironmentSpec,
    ManualClock,
    RefusedError,
    Weights,
)
from gfm.envs.control_settings import ControlSettings
from gfm.envs.registry import EnvironmentSettings
from gfm.recording.weights_file import earlier, read_weights, write_weights
from gfm.rl.learner_state import LearnerSettings, state_arrays
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.environment_words import environment_words
from gfm.service.metrics import METRICS, FolderMetrics, NoMetrics
from gfm.transport import MemoryHub, MemoryTransport
from gfm_learner.__main__ import main
from gfm_learner.checkpoint import CHECKPOINT, POLICY, begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService, LearningDivergedError
from gfm_wire import EnvironmentRequest, NotReady, SampleRequest, WeightsRequest

SPEC = EnvironmentSpec(name="test", observation_size=3, action_size=2)
LEARNING = LearnerSettings(
    policy_hidden=(8, 8),
    critic_hidden=(8, 8),
    samples=2,
    discount=0.9,
    target_period=2,
    normaliser_steps=5,
    critic_first_steps=0,
)


def config(**changes):
    return LearnerConfig(
        **({"name": "learner", "learning": LEARNING, "batch_size": 4, "metrics_every": 1} | changes)
    )


def batch(seed=0, size=4, life=10**9):
    rng = np.random.default_rng(seed)

    def draw(*shape):
        return rng.standard_normal((size, *shape), dtype=np.float32)

    return Batch(
        spec_digest=SPEC.digest,
        index=np.arange(size) + 100 * seed,
        probability=np.full(size, 0.01, np.float32),
        weights_life=np.full(size, life),
        weights_version=np.zeros(size, np.int64),
        observation=draw(4, 3),
        action=draw(3, 2),
        reward=draw(3),
        discount=np.ones((size, 3), np.float32),
        log_prob=draw(3),
    )


class Bench:
    """A learner, someone who answers as replay, and someone who listens as an actor."""

    def __init__(self, settings=None, metrics=None):
        self.clock = ManualClock(10**9)
        self.hub = MemoryHub()
        self.config = settings or config()
        self.learner = LearnerService(
            self.config,
            begin(self.config, SPEC),
            self.transport("learner"),
            self.clock,
            metrics or NoMetrics(),
        )
        self.actor = self.transport("actor")
        self.broadcasts = self.actor.subscribe("weights", keep=100)
        self.samples = self.transport("replay").serve("replay/sample")
        self.asked = []

    def transport(self, name):
        return MemoryTransport(self.hub, name=name, clock=self.clock)

    def answer(self, make=lambda number: batch(number)):
        while (request := self.samples.receive()) is not None:
            self.asked.append(request.message)
            request.reply(make(len(self.asked)))

    def learn(self, steps):
        for _ in range(1000):
            if self.steps >= steps:
                return
            self.learner.step()
            self.answer()
        raise AssertionError(f"{self.steps} steps, expected {steps}: {self.learner.status().note}")

    @property
    def steps(self):
        return self.learner.status().counters["learner_steps"]

    def versions(self):
        found = []
        while (message := self.broadcasts.take()) is not None:
            found.append(message.version)
        return found


def test_the_first_weights_go_out_before_there_is_any_batch():
    bench = Bench()
    bench.learner.step()
    weights = bench.broadcasts.take()
    assert (weights.version, weights.spec_digest) == (0, SPEC.digest)
    assert GaussianPolicy.from_weights(weights).action_size == 2


def test_asks_ahead_for_batches_of_its_environment():
    bench = Bench(config(prefetch=2))
    bench.learner.step()
    bench.answer(lambda _: NotReady(reason="filling"))
    assert [(one.batch_size, one.spec_digest) for one in bench.asked] == [(4, SPEC.digest)] * 2
    assert all(len(one.seen) == 0 for one in bench.asked)


def test_tells_replay_once_how_much_it_erred_about_each_sequence_of_a_batch():
    bench = Bench()
    bench.learn(6)
    told = [one for one in bench.asked if len(one.seen)]
    assert len(told) >= 4
    for number, one in enumerate(told, start=1):
        np.testing.assert_array_equal(one.seen, np.arange(4) + 100 * number)
        assert (one.priority > 0.0).all()


def test_publishes_whenever_the_targets_change():
    bench = Bench()
    bench.learn(6)
    assert bench.versions() == [0, 2, 4, 6]


def test_repeats_the_weights_as_a_sign_of_life_while_it_waits():
    bench = Bench(config(heartbeat_s=1.0))
    for _ in range(5):
        bench.learner.step()
        bench.clock.advance_s(0.5)
    assert bench.versions() == [0, 0, 0]


def test_says_what_it_waits_for_and_asks_again_after_a_pause():
    bench = Bench(config(prefetch=1))
    bench.learner.step()
    bench.answer(lambda _: NotReady(reason="3 of 64 sequences have arrived"))
    bench.learner.step()
    assert bench.learner.status().note == "3 of 64 sequences have arrived"
    bench.learner.step()
    bench.answer()
    assert len(bench.asked) == 1
    bench.clock.advance_s(0.1)
    bench.learn(1)
    assert bench.learner.status().note == "learning"


def test_goes_on_when_replay_comes_back(caplog):
    caplog.set_level("INFO")
    bench = Bench(config(prefetch=1, timeout_s=1.0))
    bench.learner.step()
    while bench.samples.receive() is not None:
        pass  # taken, and never answered
    bench.clock.advance_s(2.0)
    bench.learner.step()
    assert "no answer from replay/sample" in bench.learner.status().note
    assert bench.learner.status().counters["batches_unanswered"] == 1
    bench.clock.advance_s(0.1)
    bench.learn(1)
    assert [line.split(",")[0] for line in caplog.messages] == [
        "replay does not answer",
        "replay answers again",
    ]


HOSTILE = {
    "digest": {"spec_digest": "0123456789abcdef"},
    "reward": {"reward": np.full((4, 3), 1e30, np.float32)},
    "observation": {"observation": np.full((4, 4, 3), 1e30, np.float32)},
    "action": {"action": np.full((4, 3, 2), 1e30, np.float32)},
    "log_prob": {"log_prob": np.full((4, 3), -1e30, np.float32)},
    "discount": {"discount": np.full((4, 3), 1e30, np.float32)},
    "sizes": {"observation": np.zeros((4, 4, 9), np.float32)},
    "never": {"probability": np.array([0.1, 0.1, 0.0, 0.1], np.float32)},
    "too_often": {"probability": np.array([0.1, 0.1, 1.5, 0.1], np.float32)},
}


@pytest.mark.parametrize(
    "message",
    [
        *(replace(batch(), **changes) for changes in HOSTILE.values()),
        batch(size=5),
        batch(size=0),
        SampleRequest(batch_size=4),
    ],
    ids=[*HOSTILE, "too_many", "none", "kind"],
)
def test_a_batch_that_was_not_asked_for_is_refused_counted_and_not_learned_from(message):
    bench = Bench(config(prefetch=1))
    bench.learner.step()
    bench.answer(lambda _: message)
    bench.learner.step()
    counters = bench.learner.status().counters
    assert counters["refused_batch"] == counters["refused_from_replay"] == 1
    assert bench.steps == 0
    bench.clock.advance_s(0.1)
    bench.learn(1)


def test_versions_of_another_life_are_not_compared_with_its_own():
    bench = Bench()
    bench.learn(1)
    gauges = bench.learner.status().gauges
    assert (gauges["earlier_life_share"], gauges["staleness_max_steps"]) == (0.0, 0.0)
    mixed = replace(
        batch(),
        weights_life=np.array([1, 1, 1, 10**9]),
        weights_version=np.array([2**62, 2**62, 0, 0]),
    )
    while bench.steps < 5:  # some were asked for ahead
        bench.learner.step()
        bench.answer(lambda _: mixed)
    gauges = bench.learner.status().gauges
    assert (gauges["earlier_life_share"], gauges["staleness_max_steps"]) == (0.75, 4.0)


def test_current_weights_are_served_to_whoever_has_the_same_environment():
    bench = Bench()
    request = WeightsRequest(spec_digest=SPEC.digest)
    reply = bench.actor.request("weights/current", request, timeout_s=5.0)
    bench.learner.step()
    assert isinstance(reply.poll(), Weights)


def test_another_environment_is_refused_with_both_values():
    bench = Bench()
    request = WeightsRequest(spec_digest="0123456789abcdef")
    reply = bench.actor.request("weights/current", request, timeout_s=5.0)
    bench.learner.step()
    with pytest.raises(RefusedError, match=f"0123456789abcdef; .*test with 3.*{SPEC.digest}"):
        reply.poll()
    assert bench.learner.status().counters["rejected_messages"] == 1


@pytest.mark.parametrize(("steps", "heard"), [(None, True), (10, True), (20, False)])
def test_an_environment_with_another_setting_is_refused_with_both_values(steps, heard):
    settings = EnvironmentSettings(horizon=10)
    bench = Bench(config(env="point_mass", environment=settings))
    told = environment_words("point_mass", EnvironmentSettings(horizon=steps)) if steps else {}
    request = WeightsRequest(spec_digest=SPEC.digest, settings=told)
    reply = bench.actor.request("weights/current", request, timeout_s=5.0)
    bench.learner.step()
    if heard:
        assert isinstance(reply.poll(), Weights)
        return
    with pytest.raises(RefusedError, match=r"has other settings: horizon 20, not 10$"):
        reply.poll()
    assert bench.learner.status().counters["refused_question"] == 1


def test_tells_actors_what_it_learns_for_with_paths_that_hold_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    environment = EnvironmentSettings(
        recordings=("a.mcap",),
        models={"velocity": "m.xml"},
        control=ControlSettings(ensemble=("coulomb_j6_1", "own.npz"), ranges="r.toml"),
    )
    bench = Bench(config(env="gfm_fit", environment=environment))
    request = EnvironmentRequest(name="gfm_fit")
    reply = bench.actor.request("run/environment", request, timeout_s=5.0)
    bench.learner.step()
    told = msgspec.json.decode(reply.poll().settings, type=EnvironmentSettings)
    assert told.recordings == (str(tmp_path / "a.mcap"),)
    assert told.models == {"velocity": str(tmp_path / "m.xml")}
    shipped, own = map(Path, told.control.ensemble)
    assert shipped.is_file()
    assert shipped.is_absolute()
    assert own == tmp_path / "own.npz"
    assert told.control.ranges == str(tmp_path / "r.toml")


def test_an_actor_for_another_environment_is_told_which_one_this_is():
    bench = Bench(config(env="gfm_fit"))
    request = EnvironmentRequest(name="point_mass")
    reply = bench.actor.request("run/environment", request, timeout_s=5.0)
    bench.learner.step()
    with pytest.raises(RefusedError, match="learns for gfm_fit, the asker for point_mass"):
        reply.poll()


def test_stops_learning_at_its_budget_and_goes_on_serving():
    bench = Bench(config(max_steps=3))
    bench.learn(3)
    for number in range(20):
        bench.clock.advance_s(1.0)
        bench.learner.step()
        bench.answer(lambda _, seed=number: batch(seed))
    assert bench.steps == 3
    assert bench.versions()[-1] == 3
    assert bench.learner.status().note == "done: 3 steps; serving weights"


def test_metrics_tell_staleness_and_reward(tmp_path):
    bench = Bench(metrics=FolderMetrics(tmp_path))
    bench.learn(3)
    bench.learner.close()
    rows = [json.loads(line) for line in (tmp_path / METRICS).read_text().splitlines()]
    assert [row["learner_step"] for row in rows] == [1, 2, 3]
    assert [row["staleness_max_steps"] for row in rows] == [0.0, 1.0, 2.0]
    assert rows[0]["reward_mean"] == pytest.approx(batch(1).reward.mean())
    assert {"kl_mean_relative", "temperature", "critic_loss"} <= rows[0].keys()
    assert list(tmp_path.glob("events.out.tfevents.*"))


def test_resumes_from_its_checkpoint_as_if_nothing_had_happened(tmp_path):
    settings = config(checkpoint_dir=str(tmp_path))
    first = Bench(settings)
    first.learn(5)
    first.learner.close()
    progress = begin(settings, SPEC)
    assert progress.state.steps == 5
    kept = first.learner._progress
    for name, array in state_arrays(kept.state).items():
        np.testing.assert_array_equal(array, state_arrays(progress.state)[name], err_msg=name)
    assert (progress.generator.get_state() == kept.generator.get_state()).all()


def test_the_policy_beside_the_checkpoint_acts_as_the_served_one(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path)))
    bench.learn(4)
    bench.learner.close()
    kept, served = read_weights(tmp_path / POLICY), bench.learner.weights
    assert (kept.version, kept.architecture) == (4, served.architecture)
    assert (kept.run, kept.life) == (served.run, served.life)
    rows = np.ones((2, 3), np.float32)
    actions = [GaussianPolicy.from_weights(w).mean_action(rows) for w in (kept, served)]
    np.testing.assert_array_equal(*actions)


def test_checkpoints_are_written_periodically(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path), checkpoint_period_s=30.0))
    bench.learn(1)
    assert not (tmp_path / CHECKPOINT).exists()
    bench.clock.advance_s(31.0)
    bench.learn(2)
    assert (tmp_path / CHECKPOINT).exists()


def test_every_start_is_a_new_life_and_later_than_that_of_its_checkpoint(tmp_path):
    settings = config(checkpoint_dir=str(tmp_path))
    first = Bench(settings)
    first.learn(5)
    first.learner.close()
    assert (first.learner.weights.life, first.learner.weights.run) == (10**9, "default")
    again = Bench(settings)  # at the same time, as with a clock that was set back
    assert (again.learner.weights.life, again.learner.weights.version) == (10**9 + 1, 5)


def test_other_settings_are_refused_with_the_keys_that_differ(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path)))
    bench.learner.close()
    learning = msgspec.structs.replace(
        LEARNING, discount=0.5, limits=msgspec.structs.replace(LEARNING.limits, epsilon=0.2)
    )
    with pytest.raises(ConfigError) as caught:
        begin(config(checkpoint_dir=str(tmp_path), learning=learning), SPEC)
    message = str(caught.value)
    assert "discount is 0.5 here, 0.9 there" in message
    assert "limits.epsilon is 0.2 here, 0.1 there" in message
    assert "samples" not in message


def test_another_environment_is_refused_by_a_checkpoint(tmp_path):
    Bench(config(checkpoint_dir=str(tmp_path))).learner.close()
    with pytest.raises(ConfigError, match="action_size is 4 here, 2 there"):
        begin(config(checkpoint_dir=str(tmp_path)), replace(SPEC, action_size=4))


def test_no_resume_begins_anew(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path)))
    bench.learn(2)
    bench.learner.close()
    assert begin(config(checkpoint_dir=str(tmp_path), resume=False), SPEC).state.steps == 0


DAMAGES = pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda _: b"", lambda _: b"junk"]
)


@DAMAGES
def test_a_damaged_checkpoint_is_refused_where_there_is_no_other(tmp_path, damage):
    Bench(config(checkpoint_dir=str(tmp_path))).learner.close()
    path = tmp_path / CHECKPOINT
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(BadInputError, match=r"checkpoint\.npz: damaged"):
        begin(config(checkpoint_dir=str(tmp_path)), SPEC)


@DAMAGES
def test_a_damaged_checkpoint_falls_back_to_the_one_before_with_a_warning(tmp_path, damage, caplog):
    settings = config(checkpoint_dir=str(tmp_path))
    bench = Bench(settings)
    for steps in (2, 4):
        bench.learn(steps)
        bench.learner.close()
    path = tmp_path / CHECKPOINT
    path.write_bytes(damage(path.read_bytes()))
    again = Bench(settings)
    assert again.steps == 2
    assert "checkpoint.npz: damaged" in caplog.text
    assert "going on from the one before" in caplog.text
    again.learn(3)
    again.learner.close()
    assert begin(settings, SPEC).state.steps == 3


def test_an_end_between_two_generations_leaves_the_one_before(tmp_path):
    settings = config(checkpoint_dir=str(tmp_path))
    bench = Bench(settings)
    bench.learn(2)
    bench.learner.close()
    (tmp_path / CHECKPOINT).replace(earlier(tmp_path / CHECKPOINT))
    assert begin(settings, SPEC).state.steps == 2


def test_a_checkpoint_of_other_settings_is_no_damaged_one(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path)))
    bench.learner.close()
    bench.learner.close()
    learning = msgspec.structs.replace(LEARNING, discount=0.5)
    with pytest.raises(ConfigError, match=r"discount is 0\.5 here"):
        begin(config(checkpoint_dir=str(tmp_path), learning=learning), SPEC)


def test_learning_goes_on_where_the_disk_is_full_and_saves_when_there_is_room(
    tmp_path, caplog, full_disk
):
    settings = config(checkpoint_dir=str(tmp_path), checkpoint_period_s=30.0)
    bench = Bench(settings, FolderMetrics(tmp_path))
    bench.learn(1)
    bench.learner.close()
    before = (tmp_path / CHECKPOINT).read_bytes()
    bench = Bench(settings, FolderMetrics(tmp_path))
    with full_disk(100):
        for steps in (2, 3):
            bench.clock.advance_s(31.0)
            bench.learn(steps)
    said = [message for message in caplog.messages if "no checkpoint" in message]
    assert len(said) == bench.learner.status().counters["checkpoints_failed"] == 2
    assert said[0] == f"no checkpoint of step 2: {tmp_path}: File too large"
    assert sum("no metrics from step 2 on" in message for message in caplog.messages) == 1
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert not list(tmp_path.glob(".*partial"))
    bench.clock.advance_s(31.0)
    bench.learn(4)
    bench.learner.close()
    assert begin(settings, SPEC).state.steps == 4
    rows = [json.loads(line) for line in (tmp_path / METRICS).read_text().splitlines()]
    assert [row["learner_step"] for row in rows] == [1, 4]


def test_tensorboard_reads_what_was_written(tmp_path):
    bench = Bench(metrics=FolderMetrics(tmp_path))
    bench.learn(3)
    bench.learner.close()
    (path,) = tmp_path.glob("events.out.tfevents.*")
    events = list(EventFileLoader(str(path)).Load())
    assert events[0].file_version == "brain.Event:2"
    assert [event.step for event in events[1:]] == [1, 2, 3]


def test_stopping_on_a_full_disk_is_one_line(tmp_path, caplog, full_disk):
    bench = Bench(config(checkpoint_dir=str(tmp_path)))
    bench.learn(1)
    with full_disk(100):
        bench.learner.close()
    (line,) = caplog.messages
    assert line == f"no checkpoint of step 1: {tmp_path}: File too large"


def test_starts_from_given_weights(tmp_path):
    source = Bench(config(seed=5))
    write_weights(tmp_path / "start.npz", source.learner.weights)
    bench = Bench(config(init=str(tmp_path / "start.npz")))
    for name, tensor in source.learner.weights.tensors.items():
        np.testing.assert_array_equal(bench.learner.weights.tensors[name], tensor)


def test_given_weights_of_another_shape_are_refused_by_name(tmp_path):
    source = Bench(config(learning=msgspec.structs.replace(LEARNING, policy_hidden=(9, 8))))
    write_weights(tmp_path / "start.npz", source.learner.weights)
    with pytest.raises(BadInputError, match=r"first\.bias is \(9,\), expected \(8,\)"):
        begin(config(init=str(tmp_path / "start.npz")), SPEC)


def test_divergence_ends_it_and_leaves_the_last_good_checkpoint(tmp_path):
    bench = Bench(config(checkpoint_dir=str(tmp_path), checkpoint_period_s=1e-3))
    bench.clock.advance_s(1.0)
    bench.learn(1)
    before = (tmp_path / CHECKPOINT).read_bytes()
    for parameter in bench.learner._progress.state.networks.critic.parameters():
        parameter.data.fill_(float("nan"))
    with pytest.raises(LearningDivergedError, match="diverged at step 2: critic_loss is nan"):
        bench.learn(2)
    bench.learner.close()
    assert (tmp_path / CHECKPOINT).read_bytes() == before


def test_a_device_that_is_not_there_is_bad_input():
    with pytest.raises(ConfigError, match="device 'nonsense' cannot be used"):
        begin(config(device="nonsense"), SPEC)


def test_the_command_refuses_an_unknown_setting_with_one_line(tmp_path, capsys):
    path = tmp_path / "learner.toml"
    path.write_text("[learning]\ndiscuont = 0.9\n")
    assert main(["--config", str(path), "--wait-s", "0"]) == 2
    assert "unknown field `discuont` - at `$.learning`" in capsys.readouterr().err
