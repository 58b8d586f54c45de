"""Certificates with which two hosts know each other."""

from __future__ import annotations

import datetime
import ipaddress
import os
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.links.parameters import AUTHORITY, CERTIFICATE, KEY

FOLDERS = ("robot", "operator")
"""Folders of the two hosts."""

VALID = datetime.timedelta(days=3650)
"""Time for which certificates hold: a robot in use must not stop on a date. Keys that have become
known to others are replaced on both hosts."""

SLACK = datetime.timedelta(days=1)
"""Time by which certificates hold earlier: clocks of hosts without a network are late."""


def write_pair(hosts: tuple[str, str], folder: Path) -> list[Path]:
    """Write the certificates of two hosts, by an authority whose own key is kept nowhere.

    Parameters
    ----------
    hosts : tuple of str
        Name or address by which each is reached: the robot's, and the operator's.
    folder : Path
        In it, folders named `FOLDERS` are made.

    Returns
    -------
    list of Path
        The two folders.

    Raises
    ------
    ParameterError
        A host has no name that a certificate can have, or a folder is there already, or cannot
        be made.
    """
    folders = [folder / name for name in FOLDERS]
    for existing in filter(os.path.lexists, folders):
        raise ParameterError(f"{existing}: is there already, and is not written over")
    authority_key = ec.generate_private_key(ec.SECP256R1())
    authority = _signed("haptic_accel", authority_key, None, authority_key)
    keys = [ec.generate_private_key(ec.SECP256R1()) for _ in hosts]
    certificates = [
        _signed(host, key, authority, authority_key) for host, key in zip(hosts, keys, strict=True)
    ]
    try:
        for made, certificate, key in zip(folders, certificates, keys, strict=True):
            made.mkdir(parents=True, mode=0o700)
            secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
            _write(made / AUTHORITY, authority.public_bytes(Encoding.PEM))
            _write(made / CERTIFICATE, certificate.public_bytes(Encoding.PEM))
            _write(made / KEY, secret)
    except OSError as error:
        raise ParameterError(f"{error.filename}: {(error.strerror or '').lower()}") from None
    return folders


def _signed(
    host: str,
    key: ec.EllipticCurvePrivateKey,
    authority: x509.Certificate | None,
    authority_key: ec.EllipticCurvePrivateKey,
) -> x509.Certificate:
    """Return the certificate of a host, or without an authority that of one."""
    try:
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, host)])
        alternative = x509.SubjectAlternativeName([_general_name(host)])
    except ValueError:
        raise ParameterError(f"{shown(repr(host))}: must be a host's name or address") from None
    now = datetime.datetime.now(datetime.timezone.utc)
    builder = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(authority.subject if authority else name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SLACK)
        .not_valid_after(now + VALID)
        .add_extension(x509.BasicConstraints(ca=not authority, path_length=None), critical=True)
    )
    if authority:
        uses = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = builder.add_extension(alternative, critical=False).add_extension(
            x509.ExtendedKeyUsage(uses), critical=False
        )
    return builder.sign(authority_key, hashes.SHA256())


def _general_name(host: str) -> x509.GeneralName:
    """Return a host as an address if it is one, else as a name."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        if not host or set(host) & set(" /:[]*"):
            raise
        return x509.DNSName(host)


def _write(path: Path, content: bytes) -> None:
    """Write a file that its owner alone can read."""
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)
