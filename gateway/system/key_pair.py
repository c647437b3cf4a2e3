"""The certificate of a TLS endpoint and its private key, and which of the two files cannot be used."""

from __future__ import annotations

import errno
import ssl
from pathlib import Path


def load_key_pair(context: ssl.SSLContext, cert_file: str, key_file: str | None) -> None:
    """Load both PEM files; OSError whose `strerror` names the file that cannot be used."""
    for name, file in (("cert_file", cert_file), ("key_file", key_file or cert_file)):
        try:
            Path(file).open("rb").close()
        except OSError as error:
            raise OSError(error.errno, f"{name} {file}: {error.strerror}") from error
    try:
        context.load_cert_chain(cert_file, key_file)
    except ssl.SSLError as error:  # its words are for developers of OpenSSL
        raise OSError(errno.EINVAL, f"cert_file {cert_file}: it and key_file are no pair") from error
