# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Certificates for the mutual authentication of two hosts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from ipaddress import ip_address
from secrets import token_hex

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from haptic_accel import ParameterError
from haptic_accel.core.parameters import shown
from haptic_accel.kits.link.zenoh import AUTHORITY, CERTIFICATE, KEY

VALID = timedelta(days=3650)
"""Validity of certificates, long enough that a robot in use does not stop on a date. Compromised
keys are replaced on both hosts."""

CURVE = ec.SECP256R1()

USES = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)
"""Uses of a host's certificate: either host may listen."""

LONGEST_NAME = 64
"""Maximum length of a common name (RFC 5280); the alternative names, which are checked, may be
longer."""

NAME = r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?"
"""Form of a host's name."""

SLACK = timedelta(days=1)
"""Time by which validity starts before creation, as clocks of hosts without a network may be
slow."""


def certified_pair(hosts: Sequence[Sequence[str]]) -> list[dict[str, bytes]]:
    """Certify hosts by an authority whose private key is not stored.

    Parameters
    ----------
    hosts : sequence of sequence of str
        Names or addresses of the hosts.

    Returns
    -------
    list of dict
        Files of each host by name, in PEM format: the authority's certificate, and the host's
        certificate and private key.

    Raises
    ------
    ParameterError
        A host's name is missing, or not allowed in a certificate.
    """
    authority_key = ec.generate_private_key(CURVE)
    # A unique name distinguishes this authority from those of other pairs.
    name = f"haptic_accel {token_hex(8)}"
    issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    authority = (
        _builder(issuer, issuer, authority_key)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(authority_key, hashes.SHA256())
    )
    pair = []
    for names in hosts:
        alternatives = x509.SubjectAlternativeName([_general_name(name) for name in names])
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, names[0][:LONGEST_NAME])])
        key = ec.generate_private_key(CURVE)
        certificate = (
            _builder(subject, issuer, key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(alternatives, critical=False)
            .add_extension(x509.ExtendedKeyUsage(USES), critical=False)
            .sign(authority_key, hashes.SHA256())
        )
        secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        public = {AUTHORITY: authority, CERTIFICATE: certificate}
        files = {name: each.public_bytes(Encoding.PEM) for name, each in public.items()}
        pair.append({**files, KEY: secret})
    return pair


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey
) -> x509.CertificateBuilder:
    now = datetime.now(timezone.utc)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SLACK)
        .not_valid_after(now + VALID)
    )


def _general_name(host: str) -> x509.GeneralName:
    """Return a host as address or name for a certificate."""
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        if re.fullmatch(NAME, host):
            return x509.DNSName(host)
    raise ParameterError(f"{shown(repr(host))}: must be the name or address of a host")
