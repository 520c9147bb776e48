"""Certificates that a system makes for itself, and who finds them."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Thread

import pytest

from gfm.cli import main
from gfm.core import BadInputError
from gfm.launch import own_system, replay_process, router_process
from gfm.launch.own_certs import OWN_CERTS, certs_to_join, own_certificates
from gfm.transport import read_credentials
from gfm_wire import Role


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """Returns the working directory, which holds nothing."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*.pem")}


def test_they_are_whole_and_their_owner_s_alone(tmp_path):
    folder = tmp_path / "run" / "certs"
    own_certificates(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    for role in Role:
        assert read_credentials(folder, role).role is role
    assert [one.name for one in folder.parent.iterdir()] == ["certs"]


def test_those_that_are_there_are_kept(tmp_path):
    own_certificates(tmp_path / "certs")
    before = contents(tmp_path / "certs")
    own_certificates(tmp_path / "certs")
    assert contents(tmp_path / "certs") == before


def test_two_that_begin_together_share_them(tmp_path):
    threads = [Thread(target=own_certificates, args=(tmp_path / "certs",)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [one.name for one in tmp_path.iterdir()] == ["certs"]
    assert read_credentials(tmp_path / "certs", Role.ROUTER).role is Role.ROUTER


@pytest.mark.parametrize("mode", [0o755, 0o710, 0o770])
@pytest.mark.usefixtures("here")
def test_a_folder_that_others_can_open_is_refused(mode):
    own_certificates(OWN_CERTS)
    OWN_CERTS.chmod(mode)
    message = f"runs/certs: has mode {mode:o} and owner {os.getuid()}, expected 700"
    with pytest.raises(BadInputError, match=message):
        own_certificates(OWN_CERTS)
    with pytest.raises(BadInputError, match=message):
        certs_to_join("", "")


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(BadInputError, match="expected a folder to write"):
        own_certificates(tmp_path / "taken" / "certs")


@pytest.mark.usefixtures("here")
def test_who_joins_finds_those_of_this_folder_unless_others_or_none_are_named():
    assert certs_to_join("", "") == ""
    own_certificates(OWN_CERTS)
    assert certs_to_join("", "") == str(OWN_CERTS)
    assert certs_to_join("tls/127.0.0.1:1", "") == str(OWN_CERTS)
    assert certs_to_join("tcp/127.0.0.1:1", "") == ""
    assert certs_to_join("", "others") == "others"


def test_a_system_of_its_own_speaks_by_tls_and_keeps_its_certificates_with_its_run(tmp_path):
    system = own_system("r", tmp_path, (router_process(), replay_process()))
    assert system.endpoint.startswith("tls/127.0.0.1:")
    assert system.certs == str(tmp_path / "certs")
    again = own_system("r", tmp_path, (router_process(),))
    assert again.certs == system.certs


@pytest.mark.parametrize("command", ["up", "router"])
def test_none_are_made_where_something_else_is_wrong(command, here, monkeypatch, capsys):
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    assert main([command, "--listen", "tcp/127.0.0.1:7447"]) == 2
    assert "with certificates: expected tls/HOST:PORT" in capsys.readouterr().err
    assert list(here.iterdir()) == []
