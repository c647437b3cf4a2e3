"""The files that a configuration refers to, the secrets in them, and its text without any.

The passwords at the broker and at Sparkplug's servers and the token of a scrape stand in files; where the
configuration names none, each may be a credential of systemd [systemd.exec(5) LoadCredential=].
"""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from pathlib import Path

from gateway.config.reading import parse
from gateway.config.schema import Config
from gateway.errors import ConfigError, Problem
from gateway.system.password_hash import unmatched_line

VARIABLE = "STARTER_GATEWAY_MQTT_PASSWORD"
SECRETS = {  # by table: the key of its file, and the credential
    "mqtt": ("password_file", "mqtt.password"),
    "metrics": ("token_file", "metrics.token"),
    "sparkplug": ("password_file", "sparkplug.password"),
}
_SECRET_FILES = {"password_file", "token_file", "key_file"}


def secret_of(table: str, config: Config, folder: str | Path, environ: Mapping[str, str]) -> str | None:
    """Return the password or token of a table, or None when there is none.

    The first of these counts: its file (relative to `folder`, the configuration's), the credential of
    systemd, for the broker the environment. ConfigError when a file cannot be used. Sparkplug has none of
    its own at the broker.
    """
    owner, (key, credential) = getattr(config, table), SECRETS[table]
    if owner is None or not getattr(owner, "urls", True):
        return None
    if file := getattr(owner, key):
        return password_in(Path(folder) / file, key=f"{table}.{key}")
    handed_on = Path(environ.get("CREDENTIALS_DIRECTORY") or os.devnull, credential)
    # systemd leaves out a credential that the unit does not load; one that is there must be usable.
    if os.path.exists(handed_on):
        return _first_line(handed_on, credential)
    return environ.get(VARIABLE) or None if table == "mqtt" else None


def password_in(path: Path, *, key: str = "password_file") -> str:
    """Return a file's first line; ConfigError when it cannot be used, or others may use it too."""
    password = _first_line(path, key)
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise _unusable(path, key, "others than its owner may use it", f"chmod 600 {path}")
    return password


def files_of(config: Config) -> dict[Path, bool]:
    """Return every file that a configuration refers to, as it is named there, and whether it is a secret."""
    given = (item for _, table in config.tables() for item in table)
    files = [
        (Path(value), name in _SECRET_FILES) for name, value in given if name.endswith("_file") and value
    ]
    return dict(
        sorted(files, key=lambda file: file[1])
    )  # of a certificate and key in one file the key counts


def without_logins(text: str, config: Config) -> tuple[str, list[str]]:
    """Return a configuration's text with logins that no password fits, and the names of these logins.

    ConfigError when a password's line cannot be found in the text, because it is written with escapes.
    """
    users = () if config.web is None else config.web.users
    for user in users:
        text = text.replace(user.password, unmatched_line())
    after = parse(text, "the copy").web
    left = [user for user in (after.users if after else ()) if user.password != unmatched_line()]
    if left:
        what = f"the password of login {left[0].name} cannot be left out"
        raise _unusable(Path("the copy"), "web.user", what, "write it without escapes, or use --secrets")
    return text, [user.name for user in users]


def _first_line(path: Path, key: str) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise _unusable(
            path, key, error.strerror or str(error), "create it, mode 0600, the gateway's own"
        ) from error
    except UnicodeDecodeError as error:
        raise _unusable(path, key, "is not UTF-8", "write it as one line of text") from error
    if not lines or not lines[0]:
        raise _unusable(path, key, "is empty", "write it as its first line")
    return lines[0]


def _unusable(path: Path, key: str, what: str, hint: str) -> ConfigError:
    return ConfigError(str(path), [Problem(key, what, hint)])
