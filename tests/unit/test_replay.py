"""The replay service: what it stores, acknowledges, hands out and refuses."""

from __future__ import annotations

import errno
import math
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from gfm.core import (
    BadInputError,
    Batch,
    ConfigError,
    EnvironmentSpec,
    ManualClock,
    RefusedError,
    Sequence,
)
from gfm.transport import MemoryHub, MemoryTransport
from gfm_replay.arrivals import OUT_OF_ORDER, Arrivals, Life
from gfm_replay.buffer import SequenceBuffer
from gfm_replay.config import ReplayConfig
from gfm_replay.journal import NAME, Journal
from gfm_replay.records import HEADER_BYTES, STATE_BYTES, encode_record
from gfm_replay.service import ReplayService
from gfm_wire import (
    Message,
    NotReady,
    RunEnvironment,
    SampleRequest,
    SequenceAck,
    StatusRequest,
)

STEPS, OBSERVATION, ACTION = 3, 5, 2
SPEC = EnvironmentSpec(name="spec", observation_size=OBSERVATION, action_size=ACTION)
SEQUENCE_BYTES = 4 * ((STEPS + 1) * OBSERVATION + STEPS * ACTION + 3 * STEPS)


LONG = 200
LONG_BYTES = 4 * ((LONG + 1) * OBSERVATION + LONG * ACTION + 3 * LONG)


def make_sequence(number: int, *, steps: int = STEPS, **changes: object) -> Sequence:
    """Returns a sequence whose every number is its own `number`, as far as ranges allow."""
    value = min(number, 100)
    sequence = Sequence(
        actor="actor-1",
        epoch=1,
        number=number,
        weights_life=1,
        weights_version=number,
        spec_digest=SPEC.digest,
        observation=np.full((steps + 1, OBSERVATION), value, np.float32),
        action=np.full((steps, ACTION), value, np.float32),
        reward=np.full(steps, value, np.float32),
        discount=np.ones(steps, np.float32),
        log_prob=np.full(steps, value, np.float32),
    )
    return replace(sequence, **changes)


class Asker:
    """A replay service and somebody who talks to it, stepped in one thread."""

    def __init__(self, *, tell: bool = True, **settings: object) -> None:
        self.clock, self.hub = ManualClock(10**9), MemoryHub()
        self.server_side = MemoryTransport(self.hub, clock=self.clock)
        self.learner = MemoryTransport(self.hub, clock=self.clock).serve("run/environment")
        self.service = ReplayService(
            ReplayConfig(name="replay", **{"min_size": 1, **settings}),
            self.server_side,
            self.clock,
            np.random.default_rng(0),
        )
        self.transport = MemoryTransport(self.hub, name="asker", clock=self.clock)
        if tell:
            self.tell()

    def tell(self, spec: EnvironmentSpec = SPEC) -> None:
        """Lets the service ask what the run learns for, and answers."""
        self.service.step()
        while (request := self.learner.receive()) is not None:
            request.reply(RunEnvironment(name=spec.name, settings="{}", spec=spec))
        self.service.step()

    def ask(self, key: str, message: Message) -> Message:
        pending = self.transport.request(key, message, timeout_s=5.0)
        self.service.step()
        answer = pending.poll()
        assert answer is not None
        return answer

    def insert(self, sequence: Sequence) -> int:
        ack = self.ask("replay/insert", sequence)
        assert isinstance(ack, SequenceAck)
        assert (ack.actor, ack.epoch) == (sequence.actor, sequence.epoch)
        assert ack.number == sequence.number
        return ack.cursor

    def sample(self, batch_size: int, spec_digest: str = SPEC.digest) -> Message:
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
    assert batch.spec_digest == SPEC.digest
    drawn = batch.weights_version
    assert set(drawn) == set(range(8))
    for array in (batch.observation, batch.action, batch.reward, batch.log_prob):
        flat = array.reshape(64, -1)
        np.testing.assert_array_equal(flat, np.broadcast_to(drawn[:, None], flat.shape))
    np.testing.assert_array_equal(batch.discount, 1.0)


def test_sampling_is_uniform_and_repeats_with_the_same_random_numbers():
    buffer = SequenceBuffer(2**20)
    for number in range(4):
        buffer.insert(make_sequence(number), Life(), SPEC)
    one, other = (buffer.sample(4000, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.weights_version, other.weights_version)
    counts = np.bincount(one.weights_version, minlength=4)
    # Four standard deviations of a binomial with n = 4000, p = 1/4.
    np.testing.assert_allclose(counts, 1000, atol=4 * np.sqrt(4000 * 0.25 * 0.75))


def drawn(asker: Asker, count: int = 4000) -> np.ndarray:
    """Returns how often each of four sequences is in a batch, as a share."""
    batch = asker.sample(count)
    assert isinstance(batch, Batch)
    return np.bincount(batch.weights_version, minlength=4) / count


def tell(asker: Asker, seen: list[int], priority: list[float]) -> None:
    request = SampleRequest(
        batch_size=1, seen=np.array(seen), priority=np.array(priority, np.float32)
    )
    assert isinstance(asker.ask("replay/sample", request), Batch)


def test_all_are_drawn_alike_until_the_learner_says_which_it_errs_about():
    asker = Asker(priority_exponent=1.0)
    for number in range(4):
        asker.insert(make_sequence(number))
    np.testing.assert_allclose(drawn(asker), 0.25, atol=0.03)
    tell(asker, [1, 2, 3, 4], [1.0, 2.0, 3.0, 4.0])
    batch = asker.sample(4000)
    np.testing.assert_allclose(
        np.bincount(batch.weights_version) / 4000, [0.1, 0.2, 0.3, 0.4], atol=0.03
    )
    np.testing.assert_array_equal(batch.index, batch.weights_version + 1)
    np.testing.assert_allclose(batch.probability, batch.index / 10, rtol=1e-6)
    # Weighted by what is drawn too often, the mean is that of all.
    assert np.mean(batch.reward[:, 0] / (4 * batch.probability)) == pytest.approx(1.5, abs=0.1)


def test_without_an_exponent_what_the_learner_says_changes_nothing():
    asker = Asker()
    for number in range(4):
        asker.insert(make_sequence(number))
    tell(asker, [1], [1000.0])
    np.testing.assert_allclose(drawn(asker), 0.25, atol=0.03)
    assert set(asker.sample(8).probability) == {np.float32(0.25)}


def test_what_the_learner_says_of_sequences_that_are_gone_or_never_were_is_no_matter():
    asker = Asker(capacity_mib=1, priority_exponent=0.5)
    asker.insert(make_sequence(0, steps=LONG))
    capacity = asker.service._buffer.capacity
    for number in range(1, capacity + 2):
        asker.insert(make_sequence(number, steps=LONG))
    tell(asker, [1, 2, capacity + 3, -7, 2**62], [1e6] * 5)
    batch = asker.sample(100)
    assert batch.index.min() > 2
    np.testing.assert_allclose(batch.probability, 1.0 / capacity, rtol=1e-6)


@pytest.mark.parametrize(
    ("seen", "priority", "message"),
    [
        ([1], [-1.0], "priority spans -1 to -1, expected 0 to 1e\\+06"),
        ([1, 1], [0.0, 1e30], "priority spans 0 to 1e\\+30, expected"),
        ([1] * 9, [1.0] * 9, "9 priorities, expected at most 8"),
    ],
)
def test_priorities_that_are_none_are_refused(seen, priority, message):
    asker = Asker(priority_exponent=1.0, max_batch_size=8)
    for number in range(4):
        asker.insert(make_sequence(number))
    with pytest.raises(RefusedError, match=message):
        tell(asker, seen, priority)
    np.testing.assert_allclose(drawn_by(asker, 8), 0.25)


def drawn_by(asker: Asker, count: int) -> np.ndarray:
    batch = asker.sample(count)
    assert isinstance(batch, Batch)
    return batch.probability


def test_after_a_restart_all_are_alike_again(tmp_path):
    settings = {"folder": str(tmp_path), "priority_exponent": 1.0}
    asker = Asker(**settings)
    for number in range(4):
        asker.insert(make_sequence(number))
    tell(asker, [1], [50.0])
    assert drawn(asker)[0] > 0.9
    killed(asker)
    np.testing.assert_allclose(drawn(Asker(**settings)), 0.25, atol=0.03)


def test_a_full_ring_forgets_the_oldest_and_never_exceeds_its_capacity():
    buffer = SequenceBuffer(SEQUENCE_BYTES * 3 + 1)
    for number in range(8):
        buffer.insert(make_sequence(number), Life(), SPEC)
    assert (len(buffer), buffer.capacity) == (3, 3)
    assert buffer.used_bytes == 3 * SEQUENCE_BYTES
    assert set(buffer.sample(100, np.random.default_rng(0)).weights_version) == {5, 6, 7}


def test_a_sequence_that_can_never_fit_is_refused_and_fixes_nothing():
    buffer = SequenceBuffer(SEQUENCE_BYTES)
    with pytest.raises(RefusedError, match=f"at most {SEQUENCE_BYTES} bytes"):
        buffer.insert(make_sequence(0, steps=STEPS + 1), Life(), SPEC)
    with pytest.raises(RefusedError, match="a sequence of 0 transitions"):
        buffer.insert(make_sequence(0, steps=0), Life(), SPEC)
    buffer.insert(make_sequence(1), Life(), SPEC)
    assert len(buffer) == 1


def keeping(folder, **settings):
    return Asker(folder=str(folder), capacity_mib=1, **settings)


def killed(asker):
    """Ends a service as kill -9 does: nothing is finished, the file is free."""
    os.close(asker.service._journal._file)
    asker.service._journal._file = None


def stored(folder):
    """Returns what a folder holds: numbers by actor and epoch, oldest first."""
    journal = Journal(folder)
    kept = journal.open()
    journal.close()
    found = {}
    for record in kept.records:
        found.setdefault((record["actor"].decode(), int(record["epoch"])), []).append(
            int(record["number"])
        )
    return found


def test_what_is_kept_on_disk_outlives_the_service_and_goes_on_as_if_nothing_had_happened(
    tmp_path,
):
    asker, always = keeping(tmp_path), Asker(capacity_mib=1)
    for number in range(5):
        asker.insert(make_sequence(number))
        always.insert(make_sequence(number))
    for one in (asker, always):
        one.sample(8)
    killed(asker)
    again = keeping(tmp_path)
    for name in ("replay_sequences", "replay_steps", "samples"):
        assert again.counters[name] == always.counters[name] > 0
    for one in (again, always):
        one.insert(make_sequence(5, actor="actor-2"))
    drawn, expected = again.sample(64), always.sample(64)
    for name in ("weights_version", "observation", "action", "reward", "discount", "log_prob"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(expected, name))


def test_what_was_acknowledged_before_the_end_is_a_duplicate_after_it(tmp_path):
    asker = keeping(tmp_path)
    for number in (0, 1, 2, 5, 4):
        asker.insert(make_sequence(number))
        asker.insert(make_sequence(number, actor="other", epoch=2**62))
    killed(asker)
    again = keeping(tmp_path)
    assert [again.insert(make_sequence(n)) for n in (5, 0, 4, 2)] == [3, 3, 3, 3]
    assert again.counters["duplicates"] == 4
    assert [again.insert(make_sequence(n)) for n in (3, 6)] == [6, 7]
    assert again.insert(make_sequence(5, actor="other", epoch=2**62)) == 3
    assert again.counters["given_up"] == 0
    again.service.close()
    assert stored(tmp_path) == {
        ("actor-1", 1): [0, 1, 2, 5, 4, 3, 6],
        ("other", 2**62): [0, 1, 2, 5, 4],
    }


def test_lives_go_on_though_most_of_what_they_sent_was_forgotten(tmp_path):
    asker = keeping(tmp_path)
    capacity = 2**20 // LONG_BYTES
    for number in range(capacity + 100):
        asker.insert(make_sequence(number, steps=LONG))
    killed(asker)
    again = keeping(tmp_path)
    assert again.service.status().gauges["replay_stored_sequences"] == capacity
    assert again.insert(make_sequence(50, steps=LONG)) == capacity + 100
    assert again.insert(make_sequence(capacity + 100, steps=LONG)) == capacity + 101
    assert (again.counters["duplicates"], again.counters["given_up"]) == (1, 0)


def test_a_sequence_that_was_being_written_at_the_end_takes_the_place_of_none(tmp_path, caplog):
    asker = keeping(tmp_path)
    capacity = 2**20 // LONG_BYTES
    for number in range(capacity):
        asker.insert(make_sequence(number, steps=LONG))
    layout = asker.service._journal._layout
    torn = make_sequence(capacity, steps=LONG)
    record = encode_record(layout, capacity + 1, torn, Life())
    os.pwrite(asker.service._journal._file, record[:100], layout.offset(capacity + 1))
    killed(asker)
    again = keeping(tmp_path)
    assert f"1 of {capacity + 1} records are damaged and left out" in caplog.text
    assert again.service.status().gauges["replay_stored_sequences"] == capacity
    again.insert(torn)
    again.service.close()
    assert stored(tmp_path)[("actor-1", 1)] == list(range(1, capacity + 1))


def test_a_damaged_record_is_left_out_with_a_warning_and_the_others_stay(tmp_path, caplog):
    asker = keeping(tmp_path)
    for number in range(5):
        asker.insert(make_sequence(number))
    place = asker.service._journal._layout.offset(3) + 200
    os.pwrite(asker.service._journal._file, b"\xff", place)
    killed(asker)
    again = keeping(tmp_path)
    assert "1 of 5 records are damaged" in caplog.text
    assert set(again.sample(200).weights_version) == {0, 1, 3, 4}
    assert again.insert(make_sequence(5)) == 6


def test_a_torn_state_falls_back_to_the_one_before_with_a_warning(tmp_path, caplog):
    asker = keeping(tmp_path)
    asker.insert(make_sequence(0))
    for _ in range(3):
        asker.sample(8)
    file = asker.service._journal._file
    os.pwrite(file, b"\0" * 50, HEADER_BYTES + 3 % 2 * STATE_BYTES + 20)
    killed(asker)
    again = keeping(tmp_path)
    assert "a state is damaged, going on from the one before" in caplog.text
    assert again.counters["samples"] == 16


def test_a_journal_in_use_of_another_capacity_or_damaged_is_refused_and_left_alone(tmp_path):
    asker = keeping(tmp_path)
    asker.insert(make_sequence(0))
    with pytest.raises(BadInputError, match="another replay service has it open"):
        keeping(tmp_path)
    killed(asker)
    path = tmp_path / NAME
    before = path.read_bytes()
    for damaged, message in (
        (b"junk" + before[4:], "damaged replay: the header is damaged"),
        (before[:-1], "damaged replay: .* bytes, expected"),
        (b"", "damaged replay: the header"),
    ):
        path.write_bytes(damaged)
        with pytest.raises(BadInputError, match=message):
            keeping(tmp_path)
        assert path.read_bytes() == damaged
    path.write_bytes(before)
    with pytest.raises(ConfigError, match=r"has room for 7489 sequences .*, expected 14979"):
        Asker(folder=str(tmp_path), capacity_mib=2)
    assert path.read_bytes() == before


def test_without_room_on_disk_nothing_is_taken_nothing_is_left_and_all_goes_on_later(
    tmp_path, full_disk
):
    asker = keeping(tmp_path)
    with full_disk(4096):
        answer = asker.ask("replay/insert", make_sequence(0))
    assert isinstance(answer, NotReady)
    assert answer.reason.startswith("the sequences' folder: ")
    assert list(tmp_path.iterdir()) == []
    assert (asker.counters["no_room"], asker.counters["replay_sequences"]) == (1, 0)
    assert asker.insert(make_sequence(0)) == 1


def test_a_disk_that_is_too_small_is_told_before_anything_is_written(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=2**20)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    asker = keeping(tmp_path)
    answer = asker.ask("replay/insert", make_sequence(0))
    assert answer.reason == "the sequences' folder: 1 of 2 MiB are free"


def test_a_disk_that_fills_up_later_takes_nothing_from_what_space_was_reserved_for(
    tmp_path, full_disk
):
    asker = keeping(tmp_path)
    asker.insert(make_sequence(0, steps=LONG))
    size = (tmp_path / NAME).stat().st_size
    with full_disk(size):
        for number in range(1, 300):  # twice round the ring
            asker.insert(make_sequence(number, steps=LONG))
    assert (tmp_path / NAME).stat().st_size == size


def test_what_cannot_be_written_does_not_count(tmp_path, monkeypatch):
    asker = keeping(tmp_path)
    asker.insert(make_sequence(0))

    def broken(*_):
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", broken)
        answer = asker.ask("replay/insert", make_sequence(1))
        assert answer.reason == "the sequences' folder: Input/output error"
        assert isinstance(asker.sample(4), Batch)
        assert "Input/output error" in asker.service.status().note
    assert asker.insert(make_sequence(1)) == 2
    killed(asker)
    assert stored(tmp_path) == {("actor-1", 1): [0, 1]}


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


def test_beyond_what_the_learner_has_taken_actors_wait_and_go_on_when_it_has():
    asker = Asker(min_size=2, min_samples_per_insert=3.0)
    for number in range(2):  # these do not count: the learner could not begin without them
        asker.insert(make_sequence(number))
    waits = "the actors wait for the learner: 0 of 3 samples are taken"
    assert asker.ask("replay/insert", make_sequence(2)) == NotReady(reason=waits, inserted=2)
    assert asker.counters["held_back"] == 1
    assert asker.counters["replay_sequences"] == 2
    assert asker.insert(make_sequence(1)) == 2  # a duplicate takes no place
    asker.sample(2)
    assert isinstance(asker.ask("replay/insert", make_sequence(2)), NotReady)
    asker.sample(1)
    assert asker.insert(make_sequence(2)) == 3
    assert isinstance(asker.ask("replay/insert", make_sequence(3)), NotReady)


@pytest.mark.parametrize(("least", "most", "size"), [(1.0, 1.0, 4), (3.5, 4.0, 7), (0.1, 8.0, 31)])
@pytest.mark.parametrize("first", ["learner", "actors"])
def test_within_bounds_that_are_taken_nobody_waits_for_ever(least, most, size, first):
    bounds = {"min_samples_per_insert": least, "max_samples_per_insert": most}
    batch = math.floor(most * size - least)
    asker = Asker(min_size=size, max_batch_size=batch, **bounds)
    with pytest.raises(ConfigError, match="could wait for one another"):
        ReplayConfig(min_size=size, max_batch_size=batch + 1, **bounds)
    inserted = 0

    def insert() -> bool:
        nonlocal inserted
        answer = asker.ask("replay/insert", make_sequence(inserted))
        inserted += isinstance(answer, SequenceAck)
        return isinstance(answer, SequenceAck)

    def sample() -> bool:
        return isinstance(asker.sample(batch), Batch)

    # Each does all that it may before the other has its turn: the worst that can happen.
    turns = [sample, insert] if first == "learner" else [insert, sample]
    for _ in range(20):
        for turn in turns:
            times = 0
            while turn() and times < 60:
                times += 1
        ratio = asker.service.status().gauges["samples_per_insert"]
        counted = max(inserted - size, 0)
        assert ratio <= most
        assert ratio * inserted >= least * counted
    assert inserted > 2 * size


def test_who_sends_much_keeps_nobody_waiting_and_is_told_what_is_too_much():
    asker = Asker()
    stranger = MemoryTransport(asker.hub, name="stranger", clock=asker.clock)
    flood = [
        stranger.request("replay/insert", make_sequence(n, actor="x"), timeout_s=5.0)
        for n in range(900)
    ]
    assert asker.insert(make_sequence(0)) == 1  # within one step
    more = [
        stranger.request("replay/insert", make_sequence(900 + n, actor="x"), timeout_s=5.0)
        for n in range(1000)
    ]
    for _ in range(40):
        asker.service.step()
    answers = [pending.poll() for pending in (*flood, *more)]
    asked_to_wait = sum(isinstance(answer, NotReady) for answer in answers)
    assert asker.counters["refused_queue"] == asker.counters["refused_from_stranger"] > 0
    assert asked_to_wait == asker.counters["refused_queue"]
    assert sum(isinstance(one, SequenceAck) for one in answers) == 1900 - asked_to_wait


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


@pytest.mark.parametrize("epoch", [0, 2, 2**62])
def test_lives_of_an_actor_count_for_themselves_and_none_ends_another(epoch):
    asker = Asker()
    asker.insert(make_sequence(0))
    assert asker.insert(make_sequence(0, epoch=epoch)) == 1
    assert asker.insert(make_sequence(1)) == 2
    assert asker.counters["replay_sequences"] == 3


def test_a_gap_that_never_closes_is_given_up_with_bounded_memory():
    life = Life()
    given_up = [life.add(number) for number in range(5, 5 + OUT_OF_ORDER + 1)]
    assert sum(given_up) == given_up[-1] == 5
    assert life.cursor == 5 + OUT_OF_ORDER + 1
    assert life.has(0)
    assert not life.has(life.cursor)


def test_a_life_that_is_first_heard_of_late_begins_there_and_nothing_counts_as_lost():
    late = 10**6
    life = Life.beginning_with(late)
    assert life.floor == late - OUT_OF_ORDER
    assert not life.has(late - 1)
    numbers = range(late, late + OUT_OF_ORDER + 1)
    assert sum(life.add(number) for number in numbers) == 0
    assert life.cursor == numbers[-1] + 1


def test_the_life_not_heard_of_for_longest_is_forgotten_first(monkeypatch):
    monkeypatch.setattr("gfm_replay.arrivals.LIVES", 2)
    arrivals = Arrivals()
    first = arrivals.life("a", 1, 0)
    arrivals.life("b", 1, 0)
    assert arrivals.life("a", 1, 0) is first
    arrivals.life("c", 1, 0)
    assert len(arrivals) == 2
    assert arrivals.life("a", 1, 0) is first


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (
            make_sequence(1, spec_digest="other"),
            f"spec_digest is 'other', expected '{SPEC.digest}'",
        ),
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
    with pytest.raises(RefusedError, match=f"spec_digest is 'other', expected '{SPEC.digest}'"):
        asker.sample(1, spec_digest="other")
    assert isinstance(asker.sample(1, spec_digest=""), Batch)


def test_questions_of_the_wrong_kind_are_refused():
    asker = Asker()
    with pytest.raises(RefusedError, match="got StatusRequest, expected Sequence"):
        asker.ask("replay/insert", StatusRequest())
    with pytest.raises(RefusedError, match="got StatusRequest, expected SampleRequest"):
        asker.ask("replay/sample", StatusRequest())
    assert asker.counters["rejected_messages"] == 2


HOSTILE = {
    "reward": ({"reward": np.full(STEPS, 1e30, np.float32)}, "range", "reward reaches 1e"),
    "observation": (
        {"observation": np.full((STEPS + 1, OBSERVATION), -1e30, np.float32)},
        "range",
        "observation reaches 1e",
    ),
    "action": ({"action": np.full((STEPS, ACTION), 1e30, np.float32)}, "range", "action reaches"),
    "log_prob": ({"log_prob": np.full(STEPS, -1e30, np.float32)}, "range", "log_prob reaches"),
    "discount": ({"discount": np.full(STEPS, 1.5, np.float32)}, "range", "expected 0 to 1"),
    "negative_discount": ({"discount": np.full(STEPS, -1, np.float32)}, "range", "expected 0 to 1"),
    "sizes": ({"action": np.zeros((STEPS, 3), np.float32)}, "range", "expected 2 in the last"),
    "no_name": ({"actor": ""}, "name", "actor is ''"),
    "name": ({"actor": "a" * 4096}, "name", "expected 1 to 64 letters"),
    "digest": ({"spec_digest": "x" * 4096}, "spec", "spec_digest is"),
}


@pytest.mark.parametrize(("changes", "word", "message"), HOSTILE.values(), ids=HOSTILE)
def test_values_that_no_environment_gives_are_refused_even_as_the_very_first(
    changes, word, message
):
    asker = Asker()
    with pytest.raises(RefusedError, match=message):
        asker.insert(make_sequence(0, **changes))
    assert asker.counters["replay_sequences"] == 0
    assert asker.counters[f"refused_{word}"] == asker.counters["refused_from_asker"] == 1
    assert asker.insert(make_sequence(0)) == 1


def test_the_largest_values_that_the_environment_gives_are_taken():
    asker = Asker()
    asker.insert(
        make_sequence(
            0,
            reward=np.full(STEPS, SPEC.reward_limit, np.float32),
            observation=np.full((STEPS + 1, OBSERVATION), -SPEC.observation_limit, np.float32),
        )
    )
    assert asker.counters["replay_sequences"] == 1


def test_a_number_far_ahead_takes_nothing_from_those_that_follow():
    asker = Asker()
    asker.insert(make_sequence(0))
    assert asker.insert(make_sequence(2**62)) == 1
    assert [asker.insert(make_sequence(number)) for number in (1, 2, 3)] == [2, 3, 4]
    assert asker.counters["replay_sequences"] == 5


def test_a_number_from_before_a_life_was_heard_of_is_not_acknowledged():
    asker = Asker()
    asker.insert(make_sequence(10**6))
    with pytest.raises(RefusedError, match="sequence 3 of actor-1, expected none before 998976"):
        asker.insert(make_sequence(3))


@pytest.mark.parametrize("size", [10**12, 2**62, 4097])
def test_a_batch_larger_than_allowed_is_refused_at_once(size):
    asker = Asker(max_samples_per_insert=4.0)
    for _ in range(2):
        with pytest.raises(RefusedError, match=f"batch_size is {size}, expected at most 4096"):
            asker.sample(size)
        asker.insert(make_sequence(0))
    assert asker.counters["refused_size"] == 2
    assert isinstance(asker.sample(1), Batch)


def test_a_batch_is_no_larger_than_what_is_kept_and_than_what_a_message_holds():
    sizes = {"observation": np.zeros((STEPS + 1, 25_000), np.float32)}
    wide = EnvironmentSpec(name="wide", observation_size=25_000, action_size=ACTION)
    asker = Asker(capacity_mib=1)
    asker.service._expected.spec = wide
    asker.insert(make_sequence(0, spec_digest=wide.digest, **sizes))
    with pytest.raises(RefusedError, match="batch_size is 3, expected at most 2"):
        asker.sample(3, wide.digest)
    asker = Asker(capacity_mib=100)
    asker.service._expected.spec = wide
    asker.insert(make_sequence(0, spec_digest=wide.digest, **sizes))
    batch = asker.sample(167, wide.digest)
    assert isinstance(batch, Batch)
    with pytest.raises(RefusedError, match="expected at most 167"):
        asker.sample(168, wide.digest)


def test_sequences_wait_until_the_learner_has_said_what_the_run_learns_for():
    asker = Asker(tell=False)
    pending = asker.transport.request("replay/insert", make_sequence(0), timeout_s=5.0)
    assert asker.sample(1) == NotReady(reason="the learner has not said what the run learns for")
    assert pending.poll() is None
    asker.tell()
    assert isinstance(pending.poll(), SequenceAck)


def test_a_length_that_was_set_holds_for_the_first_sequence_too():
    asker = Asker(sequence_length=STEPS)
    with pytest.raises(RefusedError, match=f"4 transitions, expected {STEPS}"):
        asker.insert(make_sequence(0, steps=STEPS + 1))
    assert asker.insert(make_sequence(0)) == 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"capacity_mib": 0}, "capacity_mib is 0, expected at least 1"),
        ({"min_size": 0}, "min_size is 0, expected at least 1"),
        ({"max_batch_size": 0}, "max_batch_size is 0, expected at least 1"),
        ({"max_samples_per_insert": 0.0}, "max_samples_per_insert is 0.0, expected more than 0"),
        ({"min_samples_per_insert": -1.0}, "min_samples_per_insert is -1.0, expected more than 0"),
        (
            {"min_samples_per_insert": 4.0, "max_samples_per_insert": 2.0},
            "min_samples_per_insert is 4 and max_samples_per_insert is 2, expected no more",
        ),
        (
            {"min_samples_per_insert": 4.0, "max_samples_per_insert": 8.0},
            "max_batch_size is 4096, expected at most 508 with 4 to 8 samples per insert and "
            "min_size 64",
        ),
        ({"wait_s": -1.0}, "wait_s is -1.0, expected at least 0"),
    ],
)
def test_impossible_settings_are_refused_with_their_values(settings, message):
    with pytest.raises(ConfigError, match=message):
        ReplayConfig(**settings)
