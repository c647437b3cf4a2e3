"""The authority's and the broker's certificate of a kit: the plant's, those of an earlier kit, or new ones.

They are made and looked at by the `openssl` command, in the folder that gets them.
"""

from __future__ import annotations

import ipaddress
import shutil
import ssl
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from gateway.errors import StartError, UsageError

BROKER_DAYS = 825
CA, CA_KEY, CERT, KEY = "ca.pem", "ca.key", "broker.pem", "broker.key"

_CA_DAYS = 3650
_WITHIN_S = 30.0
_NEW = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
_AUTHORITY = ("basicConstraints=critical,CA:TRUE,pathlen:0", "keyUsage=critical,keyCertSign,cRLSign")
_BROKER = (
    "basicConstraints=critical,CA:FALSE",
    "keyUsage=critical,digitalSignature",
    "extendedKeyUsage=serverAuth",
    "authorityKeyIdentifier=keyid",
)


def put_certificates(
    folder: Path, hosts: Sequence[str], given: Mapping[str, Path | None], old: Sequence[Path], *, gateway: str
) -> None:
    """Put authority, certificate and keys into a folder; the last of `hosts` is the broker of mqtt.url.

    `given` are the plant's own files, by `ca`, `cert` and `key`; else the first of the kits `old` that has an
    authority gives it. The broker's certificate is signed again where the authority's key is there. Without
    `hosts` the broker needs none, and only an authority that is there already stays.
    """
    if plants := list(filter(None, map(given.get, ("ca", "cert", "key")))):
        for source, name in zip(plants, (CA, CERT, KEY), strict=True):
            copy_pem(source, folder / name)
        _require_pair(folder, hosts)
        return
    for before in [each for each in old if (each / CA).exists()][:1]:
        for name in (CA, CA_KEY, CERT, KEY):
            if (before / name).exists():
                copy_pem(before / name, folder / name)
    if not hosts:
        return
    if not (folder / CA).exists():
        subject = f"/CN=Starter Gateway {gateway} authority"
        _make(folder, subject, _AUTHORITY, "-days", str(_CA_DAYS), "-keyout", CA_KEY, "-out", CA)
    if (folder / CA_KEY).exists():
        names = ",".join(f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
        signed = ("-CA", CA, "-CAkey", CA_KEY, "-days", str(BROKER_DAYS), "-keyout", KEY, "-out", CERT)
        _make(folder, "/CN=broker", (*_BROKER, f"subjectAltName={names}"), *signed)
    # The authority's key is the plant's, or lies elsewhere: the certificate stays as it is.
    elif missing := [host for host in hosts if not _is_for(folder, host)]:
        hint = f"fetch {CA_KEY} back into the kit, or give --ca, --cert and --key"
        raise UsageError(f"no certificate here is for {', '.join(missing)} ({hint})")


def ends_on(certificate: Path) -> str:
    """Return until when a certificate is valid, as openssl prints it."""
    shown = _openssl(certificate.parent, "x509", "-noout", "-enddate", "-in", certificate.name)
    return shown.partition("=")[2]


def copy_pem(source: Path, target: Path) -> None:
    """Copy a PEM file; UsageError when it is none."""
    text = source.read_bytes().decode("utf-8", "replace")
    if "-----BEGIN " not in text:
        raise UsageError(f"{source} is no PEM file (openssl x509 or pkey, -inform DER, makes one)")
    if "ENCRYPTED" in text:
        what = f"{source} has a passphrase, which the broker cannot ask for"
        raise UsageError(f"{what} (openssl pkey removes it)")
    target.write_text(text, "utf-8")


def _require_pair(folder: Path, hosts: Sequence[str]) -> None:
    """UsageError unless a folder's certificate is a server's, of its authority, for the broker, with its key.

    Certificates between it and the authority are in the same file.
    """
    try:
        _openssl(folder, "verify", "-purpose", "sslserver", "-CAfile", CA, "-untrusted", CERT, CERT)
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(folder / CERT, folder / KEY)
    except (StartError, ssl.SSLError) as error:
        raise UsageError(f"--ca, --cert and --key do not fit together: {error}") from error
    for host in hosts[-1:]:
        if not _is_for(folder, host):
            raise UsageError(f"--cert is not for {host}, the broker of mqtt.url (its names must be in it)")


def _is_for(folder: Path, host: str) -> bool:
    kind = "-checkip" if _is_address(host) else "-checkhost"
    with suppress(StartError):  # there is none yet
        return "does match" in _openssl(folder, "x509", "-noout", kind, host, "-in", CERT)
    return False


def _is_address(host: str) -> bool:
    with suppress(ValueError):
        return bool(ipaddress.ip_address(host))
    return False


def _make(folder: Path, subject: str, extensions: Sequence[str], *options: str) -> None:
    added = (part for each in (*extensions, "subjectKeyIdentifier=hash") for part in ("-addext", each))
    _openssl(folder, *_NEW, "-subj", subject, *added, *options)


def _openssl(folder: Path, *arguments: str) -> str:
    """Run openssl in a folder and return what it printed; StartError when it is not here, or fails."""
    program = shutil.which("openssl")
    if program is None:
        raise StartError("openssl is not here", "apt-get install openssl, or give --ca, --cert and --key")
    command = [program, *arguments]
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        reason = [line for line in lines if " lookup: " in line] or lines  # of `verify`: why
        raise StartError(f"openssl {arguments[0]}: {''.join(reason[-1:])}", "look at the files it was given")
    return done.stdout.strip()
