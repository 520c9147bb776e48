"""Makes an authority for certificates, and one certificate per role, for a system of one's own.

    DIR/authority/key.pem, certificate.pem              whoever has this key can be anybody
    DIR/ROLE/key.pem, certificate.pem, authority.pem    all that a process of that role needs

What exists is kept, so that a folder can be completed; nothing is ever written over.
"""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gfm.core import BadInputError, ConfigError
from gfm.transport.credentials import AUTHORITY, CERTIFICATE, KEY
from gfm_wire import Role

AUTHORITY_FOLDER = "authority"

LOCAL_HOSTS = ("localhost", "127.0.0.1")
"""Names under which every router is known."""

_AUTHORITY_NAME = "gfm authority"
_BACKDATED = timedelta(minutes=5)  # clocks of other machines may be late
_HOST = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]{0,251}[A-Za-z0-9_])?")
_LONGEST_DAYS = 3650


def make_certificates(
    folder: Path, hosts: Sequence[str], days: int, now: datetime
) -> Iterator[tuple[Path, bool]]:
    """Makes what is missing; yields the folder of each role, and whether anything of it was made.

    Args:
        folder: Gets a folder for the authority and for each role.
        hosts: Names and IPv4 addresses under which others reach the router, besides LOCAL_HOSTS.
        days: How long the certificates are valid.
        now: From when on.

    Raises:
        ConfigError: a host is none, or `days` is out of range.
        BadInputError: a file that exists cannot be used, or one cannot be written.
    """
    for host in hosts:
        if not _HOST.fullmatch(host):
            raise ConfigError(f"host {host!r}: expected a host's name or IPv4 address alone")
    if not 1 <= days <= _LONGEST_DAYS:
        raise ConfigError(f"days is {days}, expected 1 to {_LONGEST_DAYS}")
    _check_authority_is_there(folder)
    try:
        authority = _authority(folder / AUTHORITY_FOLDER, now, now + timedelta(days=days))
        for role in Role:
            names = (*LOCAL_HOSTS, *hosts) if role is Role.ROUTER else ()
            yield folder / role, _complete(folder / role, role, names, authority)
    except OSError as exc:
        raise BadInputError(f"{exc.filename}: {exc.strerror}; expected a folder to write") from exc


def _check_authority_is_there(folder: Path) -> None:
    """Refuses to begin anew where there are certificates of an authority that was taken away."""
    key = folder / AUTHORITY_FOLDER / KEY
    others = [role for role in Role if (folder / role / CERTIFICATE).exists()]
    if others and not key.exists():
        raise BadInputError(
            f"{key}: no such file, and {', '.join(others)} have certificates; expected the key "
            "that made them, or another folder"
        )


@final
@dataclass(frozen=True, kw_only=True)
class _Authority:
    """Who signs, when, and until when what it signs is valid."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate
    now: datetime
    end: datetime

    def issue(
        self, role: Role, hosts: Sequence[str], key: ec.EllipticCurvePrivateKey
    ) -> x509.Certificate:
        """Returns a certificate: of a router, which only listens, for its hosts; else of a client.

        A client's certificate cannot stand for a router: none of those who connect believes it.
        """
        is_router = role is Role.ROUTER
        usage = ExtendedKeyUsageOID.SERVER_AUTH if is_router else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = (
            _builder(role, self.certificate.subject, key, self.now, self.end)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([usage]), critical=True)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()),
                critical=False,
            )
        )
        if is_router:
            names = [_general_name(host) for host in dict.fromkeys(hosts)]
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        return builder.sign(self.key, hashes.SHA256())


def _authority(folder: Path, now: datetime, until: datetime) -> _Authority:
    key, _ = _kept_or_new_key(folder / KEY)
    path = folder / CERTIFICATE
    if not path.exists():
        name = _name(_AUTHORITY_NAME)
        signed = (
            _builder(_AUTHORITY_NAME, name, key, now, until)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_only_signs(), critical=True)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
            )
            .sign(key, hashes.SHA256())
        )
        _write_new(path, signed.public_bytes(serialization.Encoding.PEM))
    certificate = _certificate(path, key, now)
    end = min(until, certificate.not_valid_after_utc)
    return _Authority(key=key, certificate=certificate, now=now, end=end)


def _complete(folder: Path, role: Role, hosts: Sequence[str], authority: _Authority) -> bool:
    """Makes what a role's folder lacks, and returns whether it lacked anything."""
    key, made = _kept_or_new_key(folder / KEY)
    believed = authority.certificate.public_bytes(serialization.Encoding.PEM)
    path = folder / AUTHORITY
    if not path.exists():
        _write_new(path, believed)
        made = True
    elif path.read_bytes() != believed:
        raise _unfit(path, "is of another authority")
    path = folder / CERTIFICATE
    if not path.exists():
        issued = authority.issue(role, hosts, key)
        _write_new(path, issued.public_bytes(serialization.Encoding.PEM))
        made = True
    _check(path, role, hosts, key, authority)
    return made


def _check(
    path: Path,
    role: Role,
    hosts: Sequence[str],
    key: ec.EllipticCurvePrivateKey,
    authority: _Authority,
) -> None:
    """Refuses a role's certificate that would not serve."""
    certificate = _certificate(path, key, authority.now)
    if certificate.subject != _name(role):
        raise _unfit(path, f"is of {certificate.subject.rfc4514_string()}, not of CN={role}")
    try:
        certificate.verify_directly_issued_by(authority.certificate)
    except (ValueError, TypeError, InvalidSignature) as exc:
        raise _unfit(path, "is of another authority") from exc
    lacking = [host for host in hosts if _general_name(host) not in _names_of(certificate)]
    if lacking:
        raise _unfit(path, f"is not for {', '.join(lacking)}")


def _certificate(path: Path, key: ec.EllipticCurvePrivateKey, now: datetime) -> x509.Certificate:
    """Returns a certificate that is there, if it is of `key` and still valid."""
    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError as exc:
        raise _unfit(path, "is no certificate in PEM") from exc
    if certificate.public_key() != key.public_key():
        raise _unfit(path, "is of another key than the one beside it")
    if certificate.not_valid_after_utc <= now:
        raise _unfit(path, f"expired at {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC")
    return certificate


def _names_of(certificate: x509.Certificate) -> Sequence[x509.GeneralName]:
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return ()
    return tuple(found.value)


def _kept_or_new_key(path: Path) -> tuple[ec.EllipticCurvePrivateKey, bool]:
    """Returns the key of a file, and whether it was made just now."""
    if path.exists():
        try:
            kept = serialization.load_pem_private_key(path.read_bytes(), password=None)
        except (ValueError, TypeError, UnsupportedAlgorithm) as exc:
            raise _unfit(path, "is no private key in PEM without a password") from exc
        if not isinstance(kept, ec.EllipticCurvePrivateKey):
            raise _unfit(path, "is no key of an elliptic curve")
        return kept, False
    key = ec.generate_private_key(ec.SECP256R1())
    words = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    _write_new(path, words, mode=0o600)
    return key, True


def _write_new(path: Path, content: bytes, mode: int = 0o644) -> None:
    """Writes a file that is not there yet, with its mode from the first moment on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
    except OSError:
        path.unlink()
        raise


def _builder(
    name: str,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    now: datetime,
    end: datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(_name(name))
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _BACKDATED)
        .not_valid_after(end)
    )


def _only_signs() -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _unfit(path: Path, problem: str) -> BadInputError:
    return BadInputError(f"{path}: {problem}; remove the folder {path.parent} to have it made anew")
