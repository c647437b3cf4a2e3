"""A configuration with everything that is read and computed from it, made outside the app's loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.app.capacity import LineCapacity, computed_of, missed_deadlines, prospects_of
from gateway.config.load import load
from gateway.config.mistakes import Mistake
from gateway.config.schema import Config
from gateway.config.secrets import metrics_token, mqtt_password, sparkplug_password
from gateway.errors import ConfigError

_SECRETS: Mapping[tuple[str, str], Callable[..., str | None]] = {  # given the broker's password, too
    ("mqtt", "password_file"): lambda config, folder, _, environ: mqtt_password(config, folder, environ),
    ("metrics", "token_file"): lambda config, folder, _, environ: metrics_token(config, folder, environ),
    ("sparkplug", "password_file"): sparkplug_password,
}


@dataclass(frozen=True, slots=True)
class Site:
    """What a gateway runs by."""

    config: Config
    folder: Path  # the configuration's: relative paths begin there
    password: str | None = field(repr=False)
    prospects: tuple[LineCapacity, ...]  # what its lines will be like
    path: Path | None = None  # the configuration's file
    metrics_token: str | None = field(default=None, repr=False)
    sparkplug_password: str | None = field(default=None, repr=False)

    @classmethod
    def of(cls, config: Config, *, folder: Path, password: str | None, path: Path | None = None) -> Self:
        """Compute what follows from a configuration; some tenths of a second for hundreds of starters."""
        token = metrics_token(config, folder, {})
        return cls(config, folder, password, prospects_of(config), path, token, password)

    @classmethod
    def read(cls, path: Path, environ: Mapping[str, str]) -> Self:
        """Read a configuration's file and its secrets; ConfigError with every problem.

        This alone decides whether a configuration can be used, for `run`, a reload and `check`.
        """
        prospects: tuple[LineCapacity, ...] = ()
        secrets: dict[str, str | None] = {}

        def check(config: Config) -> list[Mistake]:
            nonlocal prospects
            prospects = prospects_of(config)
            mistakes = missed_deadlines(prospects)
            for key, read in _SECRETS.items():
                try:
                    secrets[key[0]] = read(config, path.parent, secrets.get("mqtt"), environ)
                except ConfigError as error:
                    mistakes += [Mistake(key, f"{error.path}: {p.what}", p.hint) for p in error.problems]
            return mistakes

        config = load(path, check=check)
        return cls(
            config, path.parent, secrets["mqtt"], prospects, path, secrets["metrics"], secrets["sparkplug"]
        )

    @property
    def computed(self) -> Mapping[str, Mapping[str, Any]]:
        """Return by line its computed worst-case statistics."""
        return {line.table.name: computed_of(line) for line in self.prospects}

    @property
    def state_dir(self) -> Path:
        """Return where the gateway stores what the next run needs."""
        return self.folder / self.config.gateway.state_dir
