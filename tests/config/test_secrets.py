"""Where the passwords and tokens come from: a file of the configuration, systemd, the environment."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.config.secrets import VARIABLE, secret_of
from gateway.errors import ConfigError
from tests.config.sites import site

FILE = '[mqtt]\nusername = "mcc1"\npassword_file = "mqtt.password"'
SPARKPLUG = '[sparkplug]\ngroup = "plant"\nurls = ["mqtts://one.example"]\nusername = "edge"\n\n[mqtt]'
METRICS = "[web]\n\n[metrics]\n\n[mqtt]"
METRICS_FILE = '[web]\n\n[metrics]\ntoken_file = "own.token"\n\n[mqtt]'


@pytest.mark.parametrize(
    ("table", "tables", "files", "environ", "secret"),
    [
        ("mqtt", FILE, {"mqtt.password": "pässword \nsecond line\n"}, {VARIABLE: "other"}, "pässword "),
        # below, the files are systemd's credentials too
        ("mqtt", "[mqtt]", {"mqtt.password": "credential\n"}, {VARIABLE: "environment"}, "credential"),
        ("sparkplug", SPARKPLUG, {"sparkplug.password": "edge's\n"}, {}, "edge's"),
        ("metrics", METRICS, {"metrics.token": "token\n"}, {}, "token"),
        ("metrics", METRICS_FILE, {"own.token": "file\n", "metrics.token": "credential\n"}, {}, "file"),
        ("mqtt", "[mqtt]", {}, {VARIABLE: "x"}, "x"),
        ("mqtt", "[mqtt]", {}, {VARIABLE: ""}, None),
        ("metrics", METRICS, {}, {VARIABLE: "x"}, None),
    ],
)
def test_a_secret_is_the_first_line_of_its_file_else_the_credential_else_the_environment(
    tmp_path: Path,
    table: str,
    tables: str,
    files: dict[str, str],
    environ: dict[str, str],
    secret: str | None,
) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text, "utf-8")
        (tmp_path / name).chmod(0o600)
    environ = {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path), **environ}

    assert secret_of(table, site(("[mqtt]", tables)), tmp_path, environ) == secret


@pytest.mark.parametrize(
    ("content", "mode", "reason"),
    [
        *[(b"x", mode, r"others than its owner .* \(chmod 600 .*mqtt.password\)") for mode in (0o640, 0o604)],
        (b"\nx", 0o600, "is empty"),
        (b"\xff", 0o600, "is not UTF-8"),
    ],
)
def test_a_file_that_others_may_use_or_that_holds_no_password_is_refused(
    tmp_path: Path, content: bytes, mode: int, reason: str
) -> None:
    (tmp_path / "mqtt.password").write_bytes(content)
    (tmp_path / "mqtt.password").chmod(mode)

    with pytest.raises(ConfigError, match=reason):
        secret_of("mqtt", site(("[mqtt]", FILE)), tmp_path, {})


def test_a_credential_that_cannot_be_read_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "mqtt.password").mkdir()

    with pytest.raises(ConfigError, match=r"Is a directory \(create it, mode 0600, the gateway's own\)"):
        secret_of("mqtt", site(), "/nowhere", {"CREDENTIALS_DIRECTORY": os.fspath(tmp_path)})
