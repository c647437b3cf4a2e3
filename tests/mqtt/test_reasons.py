"""Why a broker cannot be had: each cause with its hint, and no secret."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path

import pytest

from gateway.errors import BrokerError
from gateway.mqtt.connection.reasons import refused, unreachable
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from tests.mosquitto import Certificate


def tls(kind: type[ssl.SSLError], **fields: object) -> ssl.SSLError:
    error = kind()
    for name, value in fields.items():
        setattr(error, name, value)
    return error


def untrusted(code: int) -> ssl.SSLError:
    return tls(ssl.SSLCertVerificationError, verify_code=code, verify_message="why")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (unreachable("b:1", untrusted(19)), "its certificate: why (check ca_file)"),
        (unreachable("b:1", untrusted(10)), "its certificate: why (is this machine's clock right?"),
        (unreachable("b:1", untrusted(62)), "its certificate: why (give url the name"),
        (
            unreachable("b:1", tls(ssl.SSLError, reason="WRONG_VERSION")),
            "TLS: WRONG_VERSION (is this",
        ),
        (unreachable("b:1", socket.gaierror(-2)), "its name is not known (check url"),
        (unreachable("b:1", TimeoutError()), "does not answer (check url"),
        (unreachable("b:1", ConnectionRefusedError()), "nothing listens there (is the broker running?)"),
        (unreachable("b:1", OSError(113, "No route to host")), "[Errno 113] No route to host"),
        (unreachable("b:1", ValueError("Invalid host.")), "Invalid host."),
        (refused("b:1", 0x86, "Bad password"), "Bad password (check username and password)"),
        (refused("b:1", 0x97, "Quota exceeded"), "refuses the connection: Quota exceeded"),
    ],
)
def test_a_broker_that_cannot_be_had_is_explained(error: BrokerError, text: str) -> None:
    assert str(error).startswith("broker b:1")
    assert text in str(error)


def test_the_settings_show_an_address_as_in_a_url_and_no_password() -> None:
    assert "secret" not in repr(BrokerSettings("b", 1883, "mcc1", username="u", password="secret"))
    assert BrokerSettings("b", 1883, "mcc1").address == "b:1883"
    assert BrokerSettings("::1", 1883, "mcc1").address == "[::1]:1883"


def test_a_tls_context_checks_certificate_and_name_and_shows_its_own(tmp_path: Path) -> None:
    made = Certificate.make(tmp_path)

    context = TlsSettings(str(made.cert), str(made.cert), str(made.key)).context()

    assert context.check_hostname
    assert context.verify_mode is ssl.CERT_REQUIRED


@pytest.mark.parametrize(
    ("files", "what"),
    [
        ({"ca_file": "bad"}, "ca_file .*bad: no certificate in it"),
        ({"ca_file": "none"}, "ca_file .*none: No such file"),
        ({"cert_file": "bad", "key_file": "bad"}, "cert_file .*bad: it and key_file are no pair"),
        ({"cert_file": "bad", "key_file": "none"}, "^key_file .*none: No such file"),
    ],
)
def test_files_that_are_no_certificates_are_reported_by_name(
    files: dict[str, str], what: str, tmp_path: Path
) -> None:
    (tmp_path / "bad").write_text("nothing", "utf-8")

    with pytest.raises(BrokerError, match=what):
        TlsSettings(**{key: str(tmp_path / name) for key, name in files.items()}).context()
