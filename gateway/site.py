"""A configuration with all that is read and reckoned besides, made anywhere but on the app's loop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.config.load import examine
from gateway.config.prospects import LineProspect, computed_of, prospects_of
from gateway.config.schema import Config
from gateway.config.secrets import mqtt_password


@dataclass(frozen=True, slots=True)
class Site:
    """What a gateway runs by."""

    config: Config
    folder: Path  # the configuration's: relative paths begin there
    password: str | None = field(repr=False)
    computed: Mapping[str, Mapping[str, Any]]  # by line: what its figures should be at the worst

    @classmethod
    def of(cls, config: Config, *, folder: Path, password: str | None) -> Self:
        """Reckon what follows from a configuration; some tenths of a second for hundreds of starters."""
        return cls(config, folder, password, _computed(prospects_of(config)))

    @classmethod
    def read(cls, path: Path, environ: Mapping[str, str]) -> Self:
        """Read a configuration's file and its secret; ConfigError with every problem."""
        examined = examine(path)
        config, folder = examined.config, path.parent
        password = mqtt_password(config, folder, environ)
        return cls(config, folder, password, _computed(examined.prospects))

    @property
    def state_dir(self) -> Path:
        """Return where the gateway keeps what must outlive it."""
        return self.folder / self.config.gateway.state_dir


def _computed(prospects: Iterable[LineProspect]) -> dict[str, Mapping[str, Any]]:
    return {line.table.name: computed_of(line) for line in prospects}
