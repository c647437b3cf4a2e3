"""Reconnecting to the broker: with which version and after which pause, and the wording of failures.

MQTT 5 first, and 3.1.1 only to a broker that refuses 5. A refusal is a CONNACK that says so, or a connection
that the broker closed right upon the CONNECT, CLOSED times in a row, as brokers do that cannot even read a
CONNECT of MQTT 5. Closed once, it may have been ended or restarted just then. Silence is never a refusal: a
broker that stood still, or a stalled network, knows MQTT 5 as before, and 3.1.1 would hide the retained flag
of what it delivers.

`refused` and `unreachable` make a BrokerError, with a hint, from a CONNACK or an error of TCP or TLS.
"""

from __future__ import annotations

import socket
import ssl

from gateway.errors import BrokerError
from gateway.mqtt.connection.settings import BrokerSettings, Version
from gateway.system.rate_limits import Backoff

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 4.0  # one client: what SCADA misses weighs more than what a broker has to refuse
CLOSED = 2  # so often it is a refusal
FIRST_FAILURE = 0x80  # reason codes from here on [MQTT5 2.4]
UNSUPPORTED_VERSION = 0x84  # CONNACK [MQTT5 3.2.2.2]; paho says the same for code 1 of [MQTT3 3.2.2.3]
PACKET_TOO_LARGE = 0x95  # [MQTT5 3.4.2.1]
SESSION_TAKEN_OVER = 0x8E  # DISCONNECT [MQTT5 3.14.2.1]: another client has connected with our client id

_HINTS = {  # CONNACK reason codes [MQTT5 3.2.2.2]; paho translates the codes of [MQTT3 3.2.2.3] into these
    UNSUPPORTED_VERSION: "set the version of MQTT that the broker supports",
    0x85: "choose another client id",
    0x86: "check username and password",
    0x87: "check username and password, which some brokers refuse so; else let this user connect",
    0x8A: "the broker has banned this client",
}

_OTHER_NAME = "give url the name that stands in the certificate, or have one made for this name"
_OTHER_TIME = "is this machine's clock right? else renew the certificate"
_CERTIFICATE_HINTS = {9: _OTHER_TIME, 10: _OTHER_TIME, 62: _OTHER_NAME, 64: _OTHER_NAME}  # X509_V_ERR_...


def refused(address: str, reason_code: int, name: str) -> BrokerError:
    """Return the error for a CONNACK that refuses the connection."""
    return BrokerError(f"broker {address} refuses the connection: {name}", _HINTS.get(reason_code, ""))


def unreachable(address: str, error: OSError | ValueError) -> BrokerError:
    """Return the error for a TCP or TLS connection that could not be made."""
    match error:
        case ssl.SSLCertVerificationError():
            hint = _CERTIFICATE_HINTS.get(getattr(error, "verify_code", 0), "check ca_file")
            return BrokerError(f"broker {address}: its certificate: {error.verify_message}", hint)
        case ssl.SSLError():
            return BrokerError(f"broker {address}: TLS: {error.reason}", "is this its TLS port?")
        case socket.gaierror():
            return BrokerError(f"broker {address}: its name is not known", "check url and the name server")
        case TimeoutError():
            return BrokerError(f"broker {address} does not answer", "check url, network and firewall")
        case ConnectionRefusedError():
            return BrokerError(f"broker {address}: nothing listens there", "is the broker running?")
        case _:
            return BrokerError(f"broker {address}: {error}")


class Attempts:
    """Those of one client; its seed keeps it out of step with others. `version` is the next attempt's."""

    def __init__(self, settings: BrokerSettings, *, seed: int) -> None:
        self._forced = settings.version
        self.version = settings.version or Version.V5
        self._closed = 0
        self._backoff = Backoff(FIRST_RETRY_S, LAST_RETRY_S, seed=seed)

    def is_next_at_once(self, connack_code: int | None, *, is_closed: bool) -> bool:
        """Note that a connection could not be had; return whether to try at once again.

        `connack_code` is None without a CONNACK; `is_closed` says that the broker closed instead.
        """
        if self.version is not Version.V5 or self._forced is not None:
            return False
        if connack_code is None and is_closed:
            self._closed += 1
            if self._closed < CLOSED:
                return True
        elif connack_code != UNSUPPORTED_VERSION:
            return False
        self.version = Version.V311
        return True

    def pause_s(self) -> float:
        """Return how long to wait before the next attempt, which begins with the newest version."""
        self.version = self._forced or Version.V5
        self._closed = 0
        return self._backoff.next_s()

    def held(self) -> None:
        """Note that a connection has held: the next pause is short again."""
        self._backoff.reset()
