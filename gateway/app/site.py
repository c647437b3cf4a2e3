"""A configuration with all that is read and reckoned besides, made anywhere but on the app's loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.app.capacity import LineCapacity, computed_of, missed_deadlines, prospects_of
from gateway.config.load import load
from gateway.config.mistakes import Mistake
from gateway.config.schema import Config
from gateway.config.secrets import mqtt_password


@dataclass(frozen=True, slots=True)
class Site:
    """What a gateway runs by."""

    config: Config
    folder: Path  # the configuration's: relative paths begin there
    password: str | None = field(repr=False)
    prospects: tuple[LineCapacity, ...]  # what its lines will be like

    @classmethod
    def of(cls, config: Config, *, folder: Path, password: str | None) -> Self:
        """Reckon what follows from a configuration; some tenths of a second for hundreds of starters."""
        return cls(config, folder, password, prospects_of(config))

    @classmethod
    def read(cls, path: Path, environ: Mapping[str, str]) -> Self:
        """Read a configuration's file and its secret; ConfigError with every problem.

        This alone decides whether a configuration can be used, for `run`, a reload and `check`.
        """
        prospects: tuple[LineCapacity, ...] = ()

        def check(config: Config) -> list[Mistake]:
            nonlocal prospects
            prospects = prospects_of(config)
            return missed_deadlines(prospects)

        config, folder = load(path, check=check), path.parent
        return cls(config, folder, mqtt_password(config, folder, environ), prospects)

    @property
    def computed(self) -> Mapping[str, Mapping[str, Any]]:
        """Return by line what its figures should be at the worst."""
        return {line.table.name: computed_of(line) for line in self.prospects}

    @property
    def state_dir(self) -> Path:
        """Return where the gateway keeps what must outlive it."""
        return self.folder / self.config.gateway.state_dir
