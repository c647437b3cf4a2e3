"""The one secret that the gateway needs: its password at the broker."""

from __future__ import annotations

import stat
from collections.abc import Mapping
from pathlib import Path

from gateway.config.schema import Config
from gateway.errors import ConfigError, Problem

VARIABLE = "STARTER_GATEWAY_MQTT_PASSWORD"
CREDENTIAL = "mqtt.password"


def mqtt_password(config: Config, folder: str | Path, environ: Mapping[str, str]) -> str | None:
    """Return the broker's password, or None when there is none.

    The first of these counts: `password_file` (relative to `folder`, the configuration's), the systemd
    credential `mqtt.password`, the environment. ConfigError when a file cannot be used.
    """
    if config.mqtt.password_file is not None:
        return password_in(Path(folder) / config.mqtt.password_file)
    credentials = environ.get("CREDENTIALS_DIRECTORY")
    if credentials and (Path(credentials) / CREDENTIAL).exists():
        return _first_line(Path(credentials) / CREDENTIAL)
    return environ.get(VARIABLE) or None


def password_in(path: Path) -> str:
    """Return a file's first line; ConfigError when it cannot be used, or others may use it too."""
    _refuse_readable_by_others(path)
    return _first_line(path)


def _refuse_readable_by_others(path: Path) -> None:
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise _unusable(path, error.strerror or str(error), "create it, mode 0600") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise _unusable(path, "others than its owner may use it", f"chmod 600 {path}")


def _first_line(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise _unusable(path, error.strerror or str(error), "it must be the gateway's own") from error
    except UnicodeDecodeError as error:
        raise _unusable(path, "is not UTF-8", "write the password as one line of text") from error
    if not lines or not lines[0]:
        raise _unusable(path, "is empty", "write the password as its first line")
    return lines[0]


def _unusable(path: Path, what: str, hint: str) -> ConfigError:
    return ConfigError(str(path), [Problem("password_file", what, hint)])
