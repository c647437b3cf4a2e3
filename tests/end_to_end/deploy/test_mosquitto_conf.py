"""The configuration that we ship, in a real Mosquitto."""

from __future__ import annotations

from pathlib import Path

from tests.mosquitto import Certificate, StartMosquitto

DEPLOY = Path(__file__).parents[3] / "deploy"


def test_mosquitto_takes_our_options(start_mosquitto: StartMosquitto, tmp_path: Path) -> None:
    certificate = Certificate.make(tmp_path)
    lines = (DEPLOY / "mosquitto" / "mosquitto.conf").read_text("utf-8").splitlines()
    of_the_place = (
        "listener",
        "cafile",
        "certfile",
        "keyfile",
        "allow_anonymous",
        "password_file",
        "acl_file",
    )
    options = [line for line in lines if line and not line.startswith(("#", *of_the_place))]

    broker = start_mosquitto(users={"mcc1": "x"}, tls=certificate, options=options)

    assert len(options) == 5
    assert broker.url.startswith("mqtts://")
