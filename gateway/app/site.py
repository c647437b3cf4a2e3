"""A configuration with everything that is read and computed from it, made outside the app's loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.app.capacity import LineCapacity, check_watchdogs, computed_of, prospects_of
from gateway.config import SECRETS, WHERE_RIGHT, Config, Mistake, load, secret_of
from gateway.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Site:
    """What a gateway runs by."""

    config: Config
    folder: Path  # the configuration's: relative paths begin there
    secrets: Mapping[str, str | None] = field(repr=False)  # passwords and tokens, by table
    prospects: tuple[LineCapacity, ...]  # what its lines will be like
    path: Path | None = None  # the configuration's file

    @classmethod
    def of(cls, config: Config, *, folder: Path, password: str | None, path: Path | None = None) -> Self:
        """Compute what follows from a configuration; some tenths of a second for hundreds of starters."""
        token = secret_of("metrics", config, folder, {})
        secrets = {"mqtt": password, "metrics": token, "sparkplug": password}
        return cls(config, folder, secrets, prospects_of(config), path)

    @classmethod
    def read(cls, path: Path, environ: Mapping[str, str]) -> Self:
        """Read a configuration's file and its secrets; ConfigError with every problem.

        This alone decides whether a configuration can be used, for `run`, a reload and `check`.
        """
        prospects: list[LineCapacity] = []
        secrets: dict[str, str | None] = {}

        def check(config: Config) -> Iterator[Mistake]:
            yield from check_watchdogs(config, prospects)
            for table, (key, _) in SECRETS.items():
                with WHERE_RIGHT:
                    try:
                        secrets[table] = secret_of(table, config, path.parent, environ)
                    except ConfigError as error:
                        (problem,) = error.problems
                        yield Mistake((table, key), f"{error.path}: {problem.what}", problem.hint)

        config = load(path, check=check)
        return cls(config, path.parent, secrets, tuple(prospects), path)

    @property
    def password(self) -> str | None:
        """Return the broker's password."""
        return self.secrets["mqtt"]

    @property
    def computed(self) -> Mapping[str, Mapping[str, Any]]:
        """Return by line its computed worst-case statistics."""
        return {line.table.name: computed_of(line) for line in self.prospects}

    @property
    def state_dir(self) -> Path:
        """Return where the gateway stores what the next run needs."""
        return self.folder / self.config.gateway.state_dir
