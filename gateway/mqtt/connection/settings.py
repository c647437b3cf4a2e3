"""How to reach the broker, as plain values."""

from __future__ import annotations

import enum
import ssl
from dataclasses import dataclass, field

from gateway.errors import BrokerError
from gateway.system.key_pair import load_key_pair


class Version(enum.StrEnum):
    """A version of MQTT that the gateway supports."""

    V5 = "5"
    V311 = "3.1.1"


class _TlsSocket(ssl.SSLSocket):
    """Closes itself when the handshake fails; paho would leave that to the garbage collector."""

    def do_handshake(self, block: bool = False) -> None:  # noqa: FBT001, FBT002 - the overridden signature
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


@dataclass(frozen=True, slots=True)
class TlsSettings:
    """Files for an encrypted connection; without `ca_file` the system's authorities count."""

    ca_file: str | None = None
    cert_file: str | None = None  # of the client, with key_file
    key_file: str | None = None

    def context(self) -> ssl.SSLContext:
        """Return a context that checks the broker's certificate and name; BrokerError for unusable files."""
        try:
            context = ssl.create_default_context(cafile=self.ca_file)
        except OSError as error:
            is_readable = isinstance(error, ssl.SSLError)
            why = "no certificate in it" if is_readable else error.strerror
            what = f"ca_file {self.ca_file}: {why}"
            raise BrokerError(what, "name a PEM file with the authority") from error
        context.sslsocket_class = _TlsSocket
        if self.cert_file is not None:
            try:
                load_key_pair(context, self.cert_file, self.key_file)
            except OSError as error:
                raise BrokerError(str(error.strerror), "name PEM files of a matching pair") from error
        return context


@dataclass(frozen=True, slots=True)
class BrokerSettings:
    """One broker and the way to it."""

    host: str
    port: int
    client_id: str
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: TlsSettings | None = None
    version: Version | None = None  # None: 5, or 3.1.1 where the broker refuses 5
    keepalive_s: int = 6
    largest_packet: int | None = None  # asked of the broker where MQTT 5 can; None: as for commands

    @property
    def address(self) -> str:
        """Return `host:port` for texts."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"
