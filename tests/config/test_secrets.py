from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.config.secrets import VARIABLE, secret_of
from gateway.errors import ConfigError
from tests.config.sites import site

WITH_FILE = ("[mqtt]", '[mqtt]\nusername = "mcc1"\npassword_file = "mqtt.password"')


def write(path: Path, content: bytes, mode: int = 0o600) -> None:
    path.write_bytes(content)
    path.chmod(mode)


def test_the_password_is_the_first_line_of_the_file_beside_the_configuration(tmp_path: Path) -> None:
    write(tmp_path / "mqtt.password", "pässword \nsecond line\n".encode())

    assert secret_of("mqtt", site(WITH_FILE), tmp_path, {VARIABLE: "other"}) == "pässword "


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_file_that_others_may_use_is_refused(tmp_path: Path, mode: int) -> None:
    write(tmp_path / "mqtt.password", b"x", mode)

    with pytest.raises(ConfigError, match=r"others than its owner may use it \(chmod 600 .*mqtt.password\)"):
        secret_of("mqtt", site(WITH_FILE), tmp_path, {})


@pytest.mark.parametrize(
    ("content", "reason"), [(b"", "is empty"), (b"\nx", "is empty"), (b"\xff", "is not UTF-8")]
)
def test_a_file_without_a_password_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    write(tmp_path / "mqtt.password", content)

    with pytest.raises(ConfigError, match=reason):
        secret_of("mqtt", site(WITH_FILE), tmp_path, {})


def test_a_credential_of_systemd_comes_before_the_environment(tmp_path: Path) -> None:
    write(tmp_path / "mqtt.password", b"credential\n", 0o440)
    environ = {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path), VARIABLE: "environment"}

    assert secret_of("mqtt", site(), "/nowhere", environ) == "credential"


@pytest.mark.parametrize(
    ("environ", "password"), [({VARIABLE: "x"}, "x"), ({VARIABLE: ""}, None), ({}, None)]
)
def test_without_a_file_the_environment_counts(environ: dict[str, str], password: str | None) -> None:
    assert secret_of("mqtt", site(), "/nowhere", {"CREDENTIALS_DIRECTORY": "/nowhere", **environ}) == password


SPARKPLUG = (
    "[mqtt]",
    '[sparkplug]\ngroup = "plant"\nurls = ["mqtts://one.example"]\nusername = "edge"\n\n[mqtt]',
)
METRICS = ("[mqtt]", "[web]\n\n[metrics]\n\n[mqtt]")


def test_each_secret_may_be_a_credential_of_systemd(tmp_path: Path) -> None:
    write(tmp_path / "sparkplug.password", b"edge's\n", 0o440)
    write(tmp_path / "metrics.token", b"token\n", 0o440)
    environ = {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path)}

    assert secret_of("sparkplug", site(SPARKPLUG), "/nowhere", environ) == "edge's"
    assert secret_of("metrics", site(METRICS), "/nowhere", environ) == "token"


def test_a_file_of_the_configuration_comes_before_the_credential(tmp_path: Path) -> None:
    write(tmp_path / "own.token", b"file\n")
    write(tmp_path / "metrics.token", b"credential\n", 0o440)
    with_file = ("[mqtt]", '[web]\n\n[metrics]\ntoken_file = "own.token"\n\n[mqtt]')

    assert (
        secret_of("metrics", site(with_file), tmp_path, {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path)})
        == "file"
    )


def test_a_credential_that_cannot_be_read_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "mqtt.password").mkdir()

    with pytest.raises(ConfigError, match=r"Is a directory \(create it, mode 0600, the gateway's own\)"):
        secret_of("mqtt", site(), "/nowhere", {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path)})
