"""The files that a configuration refers to, the secrets in them, and its text without any.

The passwords at the broker and at Sparkplug's servers and the token of a scrape stand in files; where the
configuration names none, each may be a credential of systemd [systemd.exec(5) LoadCredential=].
"""

from __future__ import annotations

import stat
from collections.abc import Iterator, Mapping
from pathlib import Path

from pydantic import BaseModel

from gateway.config.load import parse
from gateway.config.schema import Config
from gateway.errors import ConfigError, Problem
from gateway.system.password_hash import unmatched_line

VARIABLE = "STARTER_GATEWAY_MQTT_PASSWORD"
CREDENTIAL = "mqtt.password"
SPARKPLUG_CREDENTIAL = "sparkplug.password"
METRICS_CREDENTIAL = "metrics.token"
_ENDING = "_file"  # of a key that names a file to be read
_SECRET = frozenset({"password_file", "key_file", "token_file"})


def mqtt_password(config: Config, folder: str | Path, environ: Mapping[str, str]) -> str | None:
    """Return the broker's password, or None when there is none.

    The first of these counts: `password_file` (relative to `folder`, the configuration's), the systemd
    credential `mqtt.password`, the environment. ConfigError when a file cannot be used.
    """
    if config.mqtt.password_file is not None:
        return password_in(Path(folder) / config.mqtt.password_file)
    return _credential(CREDENTIAL, environ) or environ.get(VARIABLE) or None


def metrics_token(config: Config, folder: str | Path, environ: Mapping[str, str]) -> str | None:
    """Return the token that a scrape must carry, or None; ConfigError when its file cannot be used."""
    if config.metrics is None:
        return None
    if config.metrics.token_file is None:
        return _credential(METRICS_CREDENTIAL, environ)
    return password_in(Path(folder) / config.metrics.token_file, key="metrics.token_file")


def sparkplug_password(
    config: Config, folder: str | Path, password: str | None, environ: Mapping[str, str]
) -> str | None:
    """Return the password at Sparkplug's servers: the broker's (`password`) where they are the broker."""
    table = config.sparkplug
    if table is None or not table.urls:
        return password
    if table.password_file is None:
        return _credential(SPARKPLUG_CREDENTIAL, environ)
    return password_in(Path(folder) / table.password_file, key="sparkplug.password_file")


def password_in(path: Path, *, key: str = "password_file") -> str:
    """Return a file's first line; ConfigError when it cannot be used, or others may use it too."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise _unusable(path, key, error.strerror or str(error), "create it, mode 0600") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise _unusable(path, key, "others than its owner may use it", f"chmod 600 {path}")
    return _first_line(path, key)


def files_of(config: Config) -> dict[Path, bool]:
    """Return every file that a configuration refers to, as it is named there, and whether it is a secret."""
    found: dict[Path, bool] = {}
    for path, is_secret in _files_in(config):
        found[path] = is_secret or found.get(path, False)
    return found


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


def _credential(name: str, environ: Mapping[str, str]) -> str | None:
    """Return a credential that systemd has handed on, or None."""
    folder = environ.get("CREDENTIALS_DIRECTORY")
    if not folder:
        return None
    path = Path(folder) / name
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        what = error.strerror or str(error)
        raise _unusable(path, name, what, "see LoadCredential= of the unit") from error
    return _first_line(path, name)


def _first_line(path: Path, key: str) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise _unusable(path, key, error.strerror or str(error), "it must be the gateway's own") from error
    except UnicodeDecodeError as error:
        raise _unusable(path, key, "is not UTF-8", "write it as one line of text") from error
    if not lines or not lines[0]:
        raise _unusable(path, key, "is empty", "write it as its first line")
    return lines[0]


def _unusable(path: Path, key: str, what: str, hint: str) -> ConfigError:
    return ConfigError(str(path), [Problem(key, what, hint)])


def _files_in(table: BaseModel) -> Iterator[tuple[Path, bool]]:
    for name in type(table).model_fields:
        value = getattr(table, name)
        if name.endswith(_ENDING) and value is not None:
            yield Path(value), name in _SECRET
        for item in value if isinstance(value, tuple) else (value,):
            if isinstance(item, BaseModel):
                yield from _files_in(item)
