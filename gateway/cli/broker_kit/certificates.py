"""A small certificate authority and the broker's certificate, made by the `openssl` command."""

from __future__ import annotations

import ipaddress
import shutil
import ssl
import subprocess
from pathlib import Path

from gateway.errors import StartError, UsageError

CA_DAYS, BROKER_DAYS = 3650, 825
CA, CA_KEY, CERT, KEY = "ca.pem", "ca.key", "broker.pem", "broker.key"

_WITHIN_S = 30.0
_NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
_OF_AUTHORITY = ("basicConstraints=critical,CA:TRUE,pathlen:0", "keyUsage=critical,keyCertSign,cRLSign")
_OF_BROKER = """\
basicConstraints=critical,CA:FALSE
keyUsage=critical,digitalSignature
extendedKeyUsage=serverAuth
subjectKeyIdentifier=hash
authorityKeyIdentifier=keyid
subjectAltName="""


def make_authority(folder: Path, name: str) -> None:
    """Make `ca.pem` and `ca.key`, valid for ten years; the key signs nothing but certificates of servers."""
    extensions = (*_OF_AUTHORITY, "subjectKeyIdentifier=hash")
    _openssl(
        folder,
        *("req", "-x509", *_NEW_KEY, "-days", str(CA_DAYS), "-subj", f"/CN=Starter Gateway {name} authority"),
        *(part for each in extensions for part in ("-addext", each)),
        *("-keyout", CA_KEY, "-out", CA),
    )


def sign_broker(folder: Path, hosts: tuple[str, ...]) -> None:
    """Make `broker.pem` and `broker.key` for these names and addresses, signed by the folder's authority."""
    request, extensions = folder / "broker.csr", folder / "broker.ext"
    names = (f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
    extensions.write_text(f"{_OF_BROKER}{','.join(names)}\n", "utf-8")
    try:
        subject = ("-subj", "/CN=broker", "-keyout", KEY, "-out", request.name)
        _openssl(folder, "req", "-new", *_NEW_KEY, *subject)
        signed = ("-CA", CA, "-CAkey", CA_KEY, "-days", str(BROKER_DAYS), "-extfile", extensions.name)
        _openssl(folder, "x509", "-req", "-in", request.name, *signed, "-CAcreateserial", "-out", CERT)
    finally:
        for left in (request, extensions, folder / "ca.srl"):
            left.unlink(missing_ok=True)


def ends_on(certificate: Path) -> str:
    """Return until when a certificate is valid, as openssl prints it."""
    shown = _openssl(certificate.parent, "x509", "-noout", "-enddate", "-in", certificate.name)
    return shown.partition("=")[2]


def names_missing(folder: Path, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return which names or addresses the broker's certificate in a folder is not for."""

    def is_for(name: str) -> bool:
        kind = "-checkip" if _is_address(name) else "-checkhost"
        return "does match" in _openssl(folder, "x509", "-noout", kind, name, "-in", CERT)

    return tuple(name for name in names if not is_for(name))


def require_pair(folder: Path, host: str) -> None:
    """UsageError unless a folder's certificate is a server's, of its authority, for `host`, and with its key.

    What lies between certificate and authority stands in the certificate's file.
    """
    try:
        _openssl(folder, "verify", "-purpose", "sslserver", "-CAfile", CA, "-untrusted", CERT, CERT)
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(folder / CERT, folder / KEY)
    except (StartError, ssl.SSLError) as error:
        raise UsageError(f"--ca, --cert and --key do not fit together: {error}") from error
    if names_missing(folder, (host,)):
        raise UsageError(f"--cert is not for {host}, the broker of mqtt.url (its names must be in it)")


def copy_pem(source: Path, target: Path) -> None:
    """Copy a PEM file, for its owner only; UsageError when it is none."""
    text = source.read_bytes().decode("utf-8", "replace")
    if "-----BEGIN " not in text:
        raise UsageError(f"{source} is no PEM file (openssl x509 or pkey, -inform DER, makes one)")
    if "ENCRYPTED" in text:
        what = f"{source} has a passphrase, which the broker cannot ask for"
        raise UsageError(f"{what} (openssl pkey removes it)")
    target.touch(0o600)
    target.write_text(text, "utf-8")


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _openssl(folder: Path, *arguments: str) -> str:
    """Run openssl in a folder and return what it printed; StartError when it is not here, or fails."""
    program = shutil.which("openssl")
    if program is None:
        raise StartError("openssl is not here", "apt-get install openssl, or give --ca, --cert and --key")
    done = subprocess.run(
        [program, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        stdin=subprocess.DEVNULL,
        check=False,
        umask=0o077,  # keys are for their owner only, from their first byte on
    )
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        reason = [line for line in lines if " lookup: " in line] or lines  # of `verify`: why
        raise StartError(f"openssl {arguments[0]}: {''.join(reason[-1:])}", "look at the files it was given")
    return done.stdout.strip()
