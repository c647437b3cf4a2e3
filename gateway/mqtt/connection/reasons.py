"""Why a broker cannot be had: the reason codes that count here, and errors with hints.

`refused` and `unreachable` make a BrokerError from a CONNACK, and from an error of TCP or TLS.
"""

from __future__ import annotations

import socket
import ssl

from gateway.errors import BrokerError

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
