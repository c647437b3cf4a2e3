"""The authority's and the broker's certificate of a kit, made and judged by the `openssl` command.

They are in the kit's folder. Those of a plant are put there in their place, without the authority's key.
"""

from __future__ import annotations

import ipaddress
import shutil
import ssl
import subprocess
from collections.abc import Sequence
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


def complete_certificates(folder: Path, hosts: Sequence[str], *, gateway: str) -> None:
    """Make an authority where a folder has none, and sign the broker's certificate where its key is there.

    Without the authority's key the broker's certificate stays as it is; UsageError unless it will do.
    """
    if not (folder / CA).exists():
        subject = f"/CN=Starter Gateway {gateway} authority"
        _make(folder, subject, _AUTHORITY, "-days", str(_CA_DAYS), "-keyout", CA_KEY, "-out", CA)
    if (folder / CA_KEY).exists():
        names = ",".join(f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
        signed = ("-CA", CA, "-CAkey", CA_KEY, "-days", str(BROKER_DAYS), "-keyout", KEY, "-out", CERT)
        _make(folder, "/CN=broker", (*_BROKER, f"subjectAltName={names}"), *signed)
        return
    try:  # certificates between the broker's and the authority are in the same file
        _openssl(folder, "verify", "-purpose", "sslserver", "-CAfile", CA, "-untrusted", CERT, CERT)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(folder / CERT, folder / KEY, password="")  # the broker cannot ask for one
    except (StartError, OSError) as error:  # as OSError also ssl's
        hint = f"PEM files, the key without a passphrase; or fetch {CA_KEY} back into the kit"
        raise UsageError(f"{CA}, {CERT} and {KEY} do not fit together: {error} ({hint})") from error
    if missing := [host for host in hosts if not _is_for(folder, host)]:
        hint = f"fetch {CA_KEY} back into the kit, or put a certificate with these names there"
        raise UsageError(f"{CERT} is not for {', '.join(missing)} ({hint})")


def ends_on(certificate: Path) -> str:
    """Return until when a certificate is valid, as openssl prints it."""
    shown = _openssl(certificate.parent, "x509", "-noout", "-enddate", "-in", certificate.name)
    return shown.partition("=")[2]


def _is_for(folder: Path, host: str) -> bool:
    kind = "-checkip" if _is_address(host) else "-checkhost"
    return "does match" in _openssl(folder, "x509", "-noout", kind, host, "-in", CERT)


def _is_address(host: str) -> bool:
    with suppress(ValueError):
        return bool(ipaddress.ip_address(host))
    return False


def _make(folder: Path, subject: str, extensions: Sequence[str], *options: str) -> None:
    added = (part for text in (*extensions, "subjectKeyIdentifier=hash") for part in ("-addext", text))
    _openssl(folder, *_NEW, "-subj", subject, *added, *options)


def _openssl(folder: Path, *arguments: str) -> str:
    """Run openssl in a folder and return what it printed; StartError when it is not here, or fails."""
    if shutil.which("openssl") is None:
        raise StartError("openssl is not here", "apt-get install openssl")
    done = subprocess.run(
        ["openssl", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        reason = [line for line in lines if " lookup: " in line] or lines  # of `verify`: why
        raise StartError(
            f"openssl {arguments[0]}: {''.join(reason[-1:])}",
            f"look at {CA}, {CA_KEY} and {CERT}; without {CA_KEY} nothing is signed",
        )
    return done.stdout.strip()
