"""The replay service: what it stores, acknowledges, hands out and refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import BadInputError, Batch, ConfigError, RefusedError, Sequence
from gfm.transport import MemoryHub, MemoryTransport
from gfm_replay.arrivals import OUT_OF_ORDER, Arrivals, Life
from gfm_replay.buffer import SequenceBuffer
from gfm_replay.config import ReplayConfig
from gfm_replay.files import RingFiles
from gfm_replay.service import ReplayService
from gfm_wire import Message, NotReady, SampleRequest, SequenceAck, StatusRequest

STEPS, OBSERVATION, ACTION = 3, 5, 2
SEQUENCE_BYTES = 4 * ((STEPS + 1) * OBSERVATION + STEPS * ACTION + 3 * STEPS)


def make_sequence(number: int, *, steps: int = STEPS, **changes: object) -> Sequence:
    """Returns a sequence whose every number is its own `number`."""
    sequence = Sequence(
        actor="actor-1",
        epoch=1,
        number=number,
        weights_version=number,
        spec_digest="spec",
        observation=np.full((steps + 1, OBSERVATION), number, np.float32),
        action=np.full((steps, ACTION), number, np.float32),
        reward=np.full(steps, number, np.float32),
        discount=np.ones(steps, np.float32),
        log_prob=np.full(steps, number, np.float32),
    )
    return replace(sequence, **changes)


class Asker:
    """A replay service and somebody who talks to it, stepped in one thread."""

    def __init__(self, **settings: object) -> None:
        hub = MemoryHub()
        self.server_side = MemoryTransport(hub)
        self.service = ReplayService(
            ReplayConfig(name="replay", **{"min_size": 1, **settings}),
            self.server_side,
            np.random.default_rng(0),
        )
        self._transport = MemoryTransport(hub)

    def ask(self, key: str, message: Message) -> Message:
        pending = self._transport.request(key, message, timeout_s=5.0)
        self.service.step()
        answer = pending.poll()
        assert answer is not None
        return answer

    def insert(self, sequence: Sequence) -> int:
        ack = self.ask("replay/insert", sequence)
        assert isinstance(ack, SequenceAck)
        assert (ack.actor, ack.epoch) == (sequence.actor, sequence.epoch)
        return ack.cursor

    def sample(self, batch_size: int, spec_digest: str = "spec") -> Message:
        request = SampleRequest(batch_size=batch_size, spec_digest=spec_digest)
        return self.ask("replay/sample", request)

    @property
    def counters(self) -> dict[str, int]:
        return dict(self.service.status().counters)


def test_a_sampled_sequence_is_one_that_was_inserted_with_all_its_parts():
    asker = Asker()
    for number in range(8):
        asker.insert(make_sequence(number))
    batch = asker.sample(64)
    assert isinstance(batch, Batch)
    assert batch.spec_digest == "spec"
    drawn = batch.weights_version
    assert set(drawn) == set(range(8))
    for array in (batch.observation, batch.action, batch.reward, batch.log_prob):
        flat = array.reshape(64, -1)
        np.testing.assert_array_equal(flat, np.broadcast_to(drawn[:, None], flat.shape))
    np.testing.assert_array_equal(batch.discount, 1.0)


def test_sampling_is_uniform_and_repeats_with_the_same_random_numbers():
    buffer = SequenceBuffer(2**20)
    for number in range(4):
        buffer.insert(make_sequence(number))
    one, other = (buffer.sample(4000, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.weights_version, other.weights_version)
    counts = np.bincount(one.weights_version, minlength=4)
    # Four standard deviations of a binomial with n = 4000, p = 1/4.
    np.testing.assert_allclose(counts, 1000, atol=4 * np.sqrt(4000 * 0.25 * 0.75))


def test_a_full_ring_forgets_the_oldest_and_never_exceeds_its_capacity():
    buffer = SequenceBuffer(SEQUENCE_BYTES * 3 + 1)
    for number in range(8):
        buffer.insert(make_sequence(number))
    assert (len(buffer), buffer.capacity) == (3, 3)
    assert buffer.used_bytes == 3 * SEQUENCE_BYTES
    assert set(buffer.sample(100, np.random.default_rng(0)).weights_version) == {5, 6, 7}


def test_a_sequence_that_can_never_fit_is_refused_and_fixes_nothing():
    buffer = SequenceBuffer(SEQUENCE_BYTES)
    with pytest.raises(RefusedError, match=f"at most {SEQUENCE_BYTES} bytes"):
        buffer.insert(make_sequence(0, steps=STEPS + 1))
    with pytest.raises(RefusedError, match="a sequence of 0 transitions"):
        buffer.insert(make_sequence(0, steps=0))
    buffer.insert(make_sequence(1))
    assert len(buffer) == 1


def kept_in(folder, capacity_bytes=SEQUENCE_BYTES * 3):
    return SequenceBuffer(capacity_bytes, RingFiles(folder))


def test_what_is_kept_in_files_outlives_the_service_and_goes_on_as_if_nothing_had_happened(
    tmp_path,
):
    asker, always = Asker(folder=str(tmp_path / "ring")), Asker()
    for number in range(5):
        asker.insert(make_sequence(number))
        always.insert(make_sequence(number))
    for one in (asker, always):
        one.sample(8)
    asker.service.close()
    again = Asker(folder=str(tmp_path / "ring"))
    for name in ("replay_sequences", "replay_steps", "samples"):
        assert again.counters[name] == always.counters[name] > 0
    for one in (again, always):
        one.insert(make_sequence(5, actor="actor-2"))
    drawn, expected = again.sample(64), always.sample(64)
    for name in ("weights_version", "observation", "action", "reward", "discount", "log_prob"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(expected, name))


def test_a_sequence_that_was_being_written_when_its_process_died_is_never_handed_out(tmp_path):
    buffer = kept_in(tmp_path)
    for number in range(5):
        buffer.insert(make_sequence(number))
    torn = np.load(tmp_path / "observation.npy", mmap_mode="r+")
    torn[5 % len(torn)] = np.nan  # where the sixth would go: it never got counted
    again = kept_in(tmp_path)
    batch = again.sample(100, np.random.default_rng(0))
    assert set(batch.weights_version) == {2, 3, 4}
    assert np.isfinite(batch.observation).all()


def test_files_of_another_capacity_or_damaged_ones_are_refused_and_left_alone(tmp_path):
    kept_in(tmp_path).insert(make_sequence(0))
    with pytest.raises(ConfigError, match=r"room for 3 sequences of .* bytes, expected 5"):
        kept_in(tmp_path, SEQUENCE_BYTES * 5)
    assert len(kept_in(tmp_path)) == 1
    (tmp_path / "reward.npy").write_bytes(b"not an array")
    with pytest.raises(BadInputError, match="damaged replay"):
        kept_in(tmp_path)
    (tmp_path / "ring.json").write_text('{"format": "gfm.replay/9"}')
    with pytest.raises(BadInputError, match=r"'gfm.replay/9', expected 'gfm.replay/1'"):
        kept_in(tmp_path)


def test_below_the_minimum_the_learner_is_told_what_is_missing():
    asker = Asker(min_size=3)
    asker.insert(make_sequence(0))
    assert asker.sample(1) == NotReady(
        reason="the learner waits for actors: 1 of 3 sequences have arrived", inserted=1, needed=3
    )
    assert asker.service.status().note.startswith("the learner waits for actors: 1 of 3")
    asker.insert(make_sequence(1))
    asker.insert(make_sequence(2))
    assert isinstance(asker.sample(1), Batch)


def test_samples_per_insert_stay_below_their_limit():
    asker = Asker(max_samples_per_insert=2.0)
    for number in range(3):
        asker.insert(make_sequence(number))
    assert isinstance(asker.sample(4), Batch)
    assert isinstance(asker.sample(2), Batch)
    held_back = asker.sample(2)
    assert isinstance(held_back, NotReady)
    assert (held_back.inserted, held_back.needed) == (3, 4)
    asker.insert(make_sequence(3))
    assert isinstance(asker.sample(2), Batch)
    assert asker.service.status().gauges["samples_per_insert"] == 2.0


def test_a_sequence_sent_twice_is_stored_once_and_acknowledged_both_times():
    asker = Asker()
    assert asker.insert(make_sequence(0)) == 1
    assert asker.insert(make_sequence(0)) == 1
    assert asker.counters["replay_sequences"] == 1
    assert asker.counters["replay_steps"] == STEPS
    assert asker.counters["duplicates"] == 1


def test_sequences_that_overtake_each_other_are_all_stored_and_the_cursor_waits_for_the_gap():
    asker = Asker()
    cursors = [asker.insert(make_sequence(number)) for number in (1, 2, 0, 2, 3)]
    assert cursors == [0, 0, 3, 3, 4]
    assert asker.counters["replay_sequences"] == 4
    assert asker.counters["duplicates"] == 1


def test_a_new_life_of_an_actor_counts_from_zero_and_ends_the_old_one():
    asker = Asker()
    asker.insert(make_sequence(0))
    assert asker.insert(make_sequence(0, epoch=2)) == 1
    assert asker.counters["replay_sequences"] == 2
    with pytest.raises(RefusedError, match=r"actor-1 of epoch 1 is over: .* at epoch 2"):
        asker.insert(make_sequence(1))


def test_a_gap_that_never_closes_is_given_up_with_bounded_memory():
    life = Life(epoch=1)
    given_up = [life.add(number) for number in range(5, 5 + OUT_OF_ORDER + 1)]
    assert sum(given_up) == given_up[-1] == 5
    assert life.cursor == 5 + OUT_OF_ORDER + 1
    assert life.has(0)
    assert not life.has(life.cursor)


def test_the_actor_not_heard_of_for_longest_is_forgotten_first(monkeypatch):
    monkeypatch.setattr("gfm_replay.arrivals.ACTORS", 2)
    arrivals = Arrivals()
    first = arrivals.life("a", 1)
    arrivals.life("b", 1)
    assert arrivals.life("a", 1) is first
    arrivals.life("c", 1)
    assert len(arrivals) == 2
    assert arrivals.life("a", 1) is first


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (make_sequence(1, spec_digest="other"), "spec_digest is 'other', expected 'spec'"),
        (make_sequence(1, steps=STEPS + 1), r"observation has shape \(5, 5\), expected \(4, 5\)"),
        (
            make_sequence(1, reward=np.array([0, np.nan, 0], np.float32)),
            "not_finite: Sequence.reward holds NaN",
        ),
    ],
)
def test_a_sequence_that_does_not_belong_here_is_refused_counted_and_not_stored(sequence, message):
    asker = Asker()
    asker.insert(make_sequence(0))
    with pytest.raises(RefusedError, match=message):
        asker.insert(sequence)
    assert asker.counters["replay_sequences"] == 1
    refused = asker.counters.get("rejected_messages", 0) + sum(asker.server_side.rejected.values())
    assert refused == 1
    assert asker.insert(make_sequence(1)) == 2


def test_a_batch_of_another_environment_is_refused_with_both_digests():
    asker = Asker()
    asker.insert(make_sequence(0))
    with pytest.raises(RefusedError, match="spec_digest is 'other', expected 'spec'"):
        asker.sample(1, spec_digest="other")
    assert isinstance(asker.sample(1, spec_digest=""), Batch)


def test_questions_of_the_wrong_kind_are_refused():
    asker = Asker()
    with pytest.raises(RefusedError, match="got StatusRequest, expected Sequence"):
        asker.ask("replay/insert", StatusRequest())
    with pytest.raises(RefusedError, match="got StatusRequest, expected SampleRequest"):
        asker.ask("replay/sample", StatusRequest())
    assert asker.counters["rejected_messages"] == 2


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"capacity_mib": 0}, "capacity_mib is 0, expected at least 1"),
        ({"min_size": 0}, "min_size is 0, expected at least 1"),
        ({"max_samples_per_insert": 0.0}, "max_samples_per_insert is 0.0, expected more than 0"),
        ({"wait_s": -1.0}, "wait_s is -1.0, expected at least 0"),
    ],
)
def test_impossible_settings_are_refused_with_their_values(settings, message):
    with pytest.raises(ConfigError, match=message):
        ReplayConfig(**settings)
