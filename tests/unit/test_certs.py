"""`gfm certs`: what it makes, and what it leaves as it is."""

from __future__ import annotations

import shutil
import ssl
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from certificates import certificates
from gfm.cli import main
from gfm.core import BadInputError, ConfigError
from gfm.launch.certs import make_certificates
from gfm.transport import read_credentials
from gfm_wire import Role

NOW = datetime(2030, 1, 1, tzinfo=UTC)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    return certificates(tmp_path_factory.mktemp("certs"))


@pytest.fixture
def certs(made, tmp_path) -> Path:
    """Returns a folder of certificates of the test's own."""
    return Path(shutil.copytree(made, tmp_path / "certs"))


def certificate(folder: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / "certificate.pem").read_bytes())


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*.pem")}


@pytest.mark.parametrize("role", Role)
def test_every_role_has_a_certificate_of_its_name_by_the_authority(made, role):
    one, authority = certificate(made / role), certificate(made / "authority")
    assert one.subject.rfc4514_string() == f"CN={role}"
    one.verify_directly_issued_by(authority)
    assert (made / role / "authority.pem").read_bytes() == (
        made / "authority" / "certificate.pem"
    ).read_bytes()
    assert read_credentials(made, role).role is role


@pytest.mark.parametrize("role", Role)
def test_only_the_router_can_be_connected_to_and_it_connects_to_nobody(made, role):
    extensions = certificate(made / role).extensions
    uses = list(extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    server, client = ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH
    assert uses == [server if role is Role.ROUTER else client]
    assert not extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_keys_are_their_owners_alone(made):
    keys = list(made.rglob("key.pem"))
    assert len(keys) == len(Role) + 1
    assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
    assert len({path.read_bytes() for path in keys}) == len(keys)


def test_the_router_s_certificate_has_every_host_once(tmp_path):
    list(make_certificates(tmp_path, ("hub", "10.0.0.7", "localhost"), 1, NOW))
    names = certificate(tmp_path / "router").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    assert names.value.get_values_for_type(x509.DNSName) == ["localhost", "hub"]
    assert [str(a) for a in names.value.get_values_for_type(x509.IPAddress)] == [
        "127.0.0.1",
        "10.0.0.7",
    ]


def test_certificates_last_as_long_as_asked_but_no_longer_than_their_authority(tmp_path):
    list(make_certificates(tmp_path, (), 10, NOW))
    shutil.rmtree(tmp_path / "actor")
    list(make_certificates(tmp_path, (), 30, NOW + timedelta(days=1)))
    for name in ("authority", "learner", "actor"):
        assert certificate(tmp_path / name).not_valid_after_utc == NOW + timedelta(days=10)


def test_a_second_time_everything_is_kept(certs, capsys):
    before = contents(certs)
    assert main(["certs", "--out", str(certs)]) == 0
    assert contents(certs) == before
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{certs / role}: kept" for role in Role]


@pytest.mark.parametrize("lost", ["certificate.pem", "authority.pem", "key.pem certificate.pem"])
def test_what_is_missing_is_made_and_all_else_kept(certs, lost):
    before = contents(certs)
    for name in lost.split():
        (certs / "actor" / name).unlink()
    done = dict(make_certificates(certs, (), 1, datetime.now(UTC)))
    assert [folder.name for folder, is_new in done.items() if is_new] == ["actor"]
    after = contents(certs)
    assert after.keys() == before.keys()
    changed = {path.name for path, content in after.items() if before[path] != content}
    assert changed == set(lost.split()) - {"authority.pem"}
    read_credentials(certs, Role.ACTOR)


def swap(certs: Path, name: str) -> None:
    (certs / "actor" / name).write_bytes((certs / "learner" / name).read_bytes())


def of_another_authority(certs: Path) -> None:
    others = certificates(certs.with_name("others"))
    for name in ("key.pem", "certificate.pem"):
        (certs / "actor" / name).write_bytes((others / "actor" / name).read_bytes())


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda certs: swap(certs, "key.pem"), "actor/certificate.pem: is of another key than"),
        (
            lambda certs: (swap(certs, "key.pem"), swap(certs, "certificate.pem")),
            r"actor/certificate.pem: is of CN=learner, not of CN=actor; remove the folder .*actor ",
        ),
        (of_another_authority, "actor/certificate.pem: is of another authority"),
        (
            lambda certs: (certs / "actor/authority.pem").write_text("-"),
            "actor/authority.pem: is of another authority",
        ),
        (
            lambda certs: (certs / "actor/key.pem").write_text("-"),
            "actor/key.pem: is no private key in PEM",
        ),
        (
            lambda certs: (certs / "actor/certificate.pem").write_text("-"),
            "actor/certificate.pem: is no certificate in PEM",
        ),
        (
            lambda certs: shutil.rmtree(certs / "authority"),
            "authority/key.pem: no such file, and router, replay, .* have certificates",
        ),
    ],
)
def test_what_does_not_fit_is_named_and_nothing_written_over(
    certs, damage: Callable[[Path], object], message
):
    damage(certs)
    before = contents(certs)
    with pytest.raises(BadInputError, match=message):
        list(make_certificates(certs, (), 1, datetime.now(UTC)))
    assert contents(certs) == before


def test_an_expired_certificate_and_a_host_that_it_lacks_are_named(certs):
    with pytest.raises(BadInputError, match=r"router/certificate.pem: is not for hub; remove"):
        list(make_certificates(certs, ("hub",), 1, datetime.now(UTC)))
    with pytest.raises(BadInputError, match=r"authority/certificate.pem: expired at 20\d\d-.* UTC"):
        list(make_certificates(certs, (), 1, datetime.now(UTC) + timedelta(days=2)))


@pytest.mark.parametrize(
    ("hosts", "days", "message"),
    [
        (("hub:7447",), 1, "host 'hub:7447': expected a host's name or IPv4 address alone"),
        (("",), 1, "host '': expected"),
        (("::1",), 1, "host '::1': expected"),
        ((), 0, "days is 0, expected 1 to 3650"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_made(tmp_path, hosts, days, message):
    with pytest.raises(ConfigError, match=message):
        list(make_certificates(tmp_path / "certs", hosts, days, NOW))
    assert not (tmp_path / "certs").exists()


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["certs", "--out", str(tmp_path / "file")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].endswith("expected a folder to write")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "key.pem").unlink(), r"actor/key.pem: No such file .* `gfm certs` makes"),
        (lambda f: (f / "certificate.pem").write_text("-"), "actor: .*expected a key"),
        (lambda f: (f / "authority.pem").write_text("-"), "actor: .*expected a key"),
        (lambda f: swap(f.parent, "key.pem"), "actor: KEY_VALUES_MISMATCH; expected a key, its"),
    ],
)
def test_credentials_that_cannot_be_used_are_one_line(certs, spoil, message):
    spoil(certs / "actor")
    with pytest.raises(BadInputError, match=message) as caught:
        read_credentials(certs, Role.ACTOR)
    assert "\n" not in str(caught.value)


def test_without_its_package_it_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    monkeypatch.delitem(sys.modules, "gfm.launch.certs")
    assert main(["certs", "--out", str(tmp_path / "certs")]) == 2
    assert capsys.readouterr().err.endswith("pip install 'gfm-sim2real[certs]'\n")
    assert not (tmp_path / "certs").exists()


def test_the_files_serve_openssl_too(made):
    assert read_credentials(made, Role.ACTOR).context().verify_mode is ssl.CERT_REQUIRED
