from __future__ import annotations

import socket
import ssl
from pathlib import Path

import pytest

from gateway.errors import BrokerError
from gateway.mqtt.connection.reconnect import refused, unreachable
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings
from tests.mosquitto import Certificate


def certificate_error(code: int, message: str) -> ssl.SSLCertVerificationError:
    error = ssl.SSLCertVerificationError()
    error.verify_code, error.verify_message = code, message
    return error


def tls_error() -> ssl.SSLError:
    error = ssl.SSLError()
    error.reason = "WRONG_VERSION_NUMBER"
    return error


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            certificate_error(19, "self-signed certificate in certificate chain"),
            "broker b:1: its certificate: self-signed certificate in certificate chain (check ca_file)",
        ),
        (
            certificate_error(10, "certificate has expired"),
            "broker b:1: its certificate: certificate has expired "
            "(is this machine's clock right? else renew the certificate)",
        ),
        (
            certificate_error(62, "Hostname mismatch, certificate is not valid for 'b'."),
            "broker b:1: its certificate: Hostname mismatch, certificate is not valid for 'b'. "
            "(give url the name that stands in the certificate, or have one made for this name)",
        ),
        (tls_error(), "broker b:1: TLS: WRONG_VERSION_NUMBER (is this its TLS port?)"),
        (socket.gaierror(-2), "broker b:1: its name is not known (check url and the name server)"),
        (TimeoutError(), "broker b:1 does not answer (check url, network and firewall)"),
        (ConnectionRefusedError(), "broker b:1: nothing listens there (is the broker running?)"),
        (OSError(113, "No route to host"), "broker b:1: [Errno 113] No route to host"),
        (ValueError("Invalid host."), "broker b:1: Invalid host."),
    ],
)
def test_an_unreachable_broker_is_explained(error: OSError | ValueError, text: str) -> None:
    assert str(unreachable("b:1", error)) == text


def test_a_refusal_is_explained_with_its_hint_where_there_is_one() -> None:
    assert str(refused("b:1", 0x86, "Bad user name or password")) == (
        "broker b:1 refuses the connection: Bad user name or password (check username and password)"
    )
    assert str(refused("b:1", 0x87, "Not authorized")) == (
        "broker b:1 refuses the connection: Not authorized "
        "(check username and password, which some brokers refuse so; else let this user connect)"
    )
    assert str(refused("b:1", 0x97, "Quota exceeded")) == (
        "broker b:1 refuses the connection: Quota exceeded"
    )


def test_the_password_is_not_part_of_the_settings_text() -> None:
    how = BrokerSettings("b", 1883, "mcc1", username="u", password="secret")

    assert "secret" not in repr(how)


def test_an_address_is_written_as_in_a_url() -> None:
    assert BrokerSettings("b", 1883, "mcc1").address == "b:1883"
    assert BrokerSettings("::1", 1883, "mcc1").address == "[::1]:1883"


def test_a_tls_context_checks_certificate_and_name_and_shows_its_own(tmp_path: Path) -> None:
    certificate = Certificate.make(tmp_path)

    context = TlsSettings(
        ca_file=str(certificate.cert), cert_file=str(certificate.cert), key_file=str(certificate.key)
    ).context()

    assert context.check_hostname
    assert context.verify_mode is ssl.CERT_REQUIRED


def test_files_that_are_no_certificates_are_reported_by_name(tmp_path: Path) -> None:
    bad = tmp_path / "bad.pem"
    bad.write_text("nothing", "utf-8")

    with pytest.raises(BrokerError, match=r"ca_file .*bad\.pem: no certificate in it \(name a"):
        TlsSettings(ca_file=str(bad)).context()
    with pytest.raises(BrokerError, match=r"ca_file .*none\.pem: No such file or directory \(name"):
        TlsSettings(ca_file=str(tmp_path / "none.pem")).context()
    with pytest.raises(BrokerError, match=r"cert_file .*bad\.pem: it and key_file are no pair \(name PEM"):
        TlsSettings(cert_file=str(bad), key_file=str(bad)).context()
    with pytest.raises(BrokerError, match=r"^key_file .*none\.pem: No such file or directory \(name PEM"):
        TlsSettings(cert_file=str(bad), key_file=str(tmp_path / "none.pem")).context()
