"""What actors were told has arrived, laid beside what replay keeps."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gfm.core import BadInputError, EnvironmentSpec, Sequence
from gfm.service.ledger import FolderLedger, make_ledger, read_ledgers
from gfm_replay.arrivals import Life
from gfm_replay.audit import Audit, audit_folders, main
from gfm_replay.journal import Journal
from gfm_replay.records import Layout

SPEC = EnvironmentSpec(name="spec", observation_size=2, action_size=1)
STEPS = 3


def sequence(number: int, *, epoch: int = 1, reward: float = 0.5) -> Sequence:
    return Sequence(
        actor="a",
        epoch=epoch,
        number=number,
        weights_life=1,
        weights_version=1,
        spec_digest=SPEC.digest,
        observation=np.full((STEPS + 1, 2), number, np.float32),
        action=np.zeros((STEPS, 1), np.float32),
        reward=np.full(STEPS, reward, np.float32),
        discount=np.ones(STEPS, np.float32),
        log_prob=np.zeros(STEPS, np.float32),
    )


def keep(folder: Path, *sequences: Sequence, capacity: int = 100) -> None:
    journal = Journal(folder)
    journal.open()
    journal.make(Layout(spec=SPEC, steps=STEPS, capacity=capacity))
    for index, one in enumerate(sequences, start=1):
        journal.append(index, one, Life())
    journal.close()


def note(folder: Path, *sequences: Sequence) -> None:
    for one in sequences:
        FolderLedger(folder, one.actor, one.epoch).note(one)


@pytest.fixture
def folders(tmp_path) -> tuple[Path, Path]:
    return tmp_path / "replay", tmp_path / "ledgers"


def test_all_that_was_acknowledged_is_kept_once(folders):
    replay, ledgers = folders
    sent = [sequence(0), sequence(1), sequence(0, epoch=2)]
    keep(replay, *sent)
    note(ledgers, *sent)
    found = audit_folders(replay, ledgers)
    assert found == Audit(lives=2, acknowledged=3, kept=3, evicted=0, lost=0, doubled=0, changed=0)
    assert found.is_sound


def test_what_an_actor_did_not_live_to_hear_is_neither_lost_nor_doubled(folders):
    replay, ledgers = folders
    keep(replay, sequence(0), sequence(1))
    note(ledgers, sequence(0))
    assert audit_folders(replay, ledgers).is_sound


@pytest.mark.parametrize(
    ("kept", "acknowledged", "wrong"),
    [
        ([0], [0, 1], {"lost": 1}),
        ([0, 1, 1], [0, 1], {"doubled": 1}),
    ],
)
def test_a_loss_and_a_double_are_found(folders, kept, acknowledged, wrong):
    replay, ledgers = folders
    keep(replay, *map(sequence, kept))
    note(ledgers, *map(sequence, acknowledged))
    found = audit_folders(replay, ledgers)
    assert found == replace(found, **({"lost": 0, "doubled": 0, "changed": 0} | wrong))
    assert not found.is_sound


def test_other_values_than_were_sent_are_found(folders):
    replay, ledgers = folders
    keep(replay, sequence(0, reward=0.25))
    note(ledgers, sequence(0))
    assert audit_folders(replay, ledgers).changed == 1


def test_what_made_room_is_not_lost_and_what_else_is_missing_is(folders):
    replay, ledgers = folders
    keep(replay, *map(sequence, range(7)), capacity=4)
    note(ledgers, *map(sequence, range(9)))
    found = audit_folders(replay, ledgers)
    assert (found.kept, found.evicted, found.lost) == (4, 3, 2)


def test_a_line_that_was_being_written_when_the_actor_died_does_not_count(tmp_path):
    note(tmp_path, sequence(7))
    with (tmp_path / "a.1.acked").open("a") as file:
        file.write("8 01ab")
    assert read_ledgers(tmp_path) == {("a", 1): {7: sequence(7).checksum}}


def test_names_with_dots_are_read_back(tmp_path):
    FolderLedger(tmp_path, "actor-h.example", 12).note(sequence(3))
    assert list(read_ledgers(tmp_path)) == [("actor-h.example", 12)]


def test_no_folder_is_no_ledger_and_a_file_in_its_place_is_bad_input(tmp_path):
    make_ledger("", "a", 1).note(sequence(0))
    (tmp_path / "file").touch()
    with pytest.raises(BadInputError, match=r"ledger .*file/a.1.acked: cannot be written"):
        make_ledger(str(tmp_path / "file"), "a", 1)


def test_a_full_disk_is_said_once_and_acting_goes_on(tmp_path, full_disk, caplog):
    ledger = FolderLedger(tmp_path, "a", 1)
    ledger.note(sequence(0))
    with full_disk(1):
        ledger.note(sequence(1))
        ledger.note(sequence(2))
    ledger.note(sequence(3))
    assert list(read_ledgers(tmp_path)["a", 1]) == [0, 3]
    assert len(caplog.records) == 1


def test_the_command_prints_json_and_its_status_says_whether_all_is_well(folders, capsys):
    replay, ledgers = folders
    keep(replay, sequence(0))
    note(ledgers, sequence(0))
    argv = ["--folder", str(replay), "--ledgers", str(ledgers)]
    assert main(argv) == 0
    assert json.loads(capsys.readouterr().out)["acknowledged"] == 1
    note(ledgers, sequence(1))
    assert main(argv) == 1


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ("", "ledgers .*: cannot be read"),
        ("ledgers", "has no ledger, expected NAME.EPOCH.acked of actors"),
        ("ledgers/a.1.acked", r"a.1.acked: .* expected NUMBER CHECKSUM in every line"),
    ],
)
def test_folders_that_are_none_are_one_line_and_status_two(folders, made, message, capsys):
    replay, ledgers = folders
    keep(replay, sequence(0))
    if made:
        ledgers.mkdir()
    if made.endswith("acked"):
        (ledgers / "a.1.acked").write_text("seven\n")
    assert main(["--folder", str(replay), "--ledgers", str(ledgers)]) == 2
    assert re.search(message, capsys.readouterr().err)
