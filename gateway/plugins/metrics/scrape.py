"""What a scrape reads of the gateway, as it is at that moment; pure.

Readings come from the starters' snapshots, not from published values: those are as old as `refresh_s` allows
while nothing changes, and a gateway that begins to be scraped would not know them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from gateway.starters.telemetry.snapshot import Reading
from gateway.system.stalls import Delays


@dataclass(frozen=True, slots=True)
class MetricsSettings:
    """What the metrics run by."""

    has_all_points: bool = False
    textfile: Path | None = None
    token: str | None = field(default=None, repr=False)  # that a scrape must carry


@dataclass(frozen=True, slots=True)
class ScrapedStarter:
    """One starter; `readings` are those that the gateway goes on writing to, one by one."""

    name: str
    line: str
    address: int
    family: str
    model: str | None
    firmware: str | None
    is_enabled: bool
    is_online: bool
    is_locked: bool
    state: str
    readings: Mapping[str, Reading]
    fault_codes: tuple[str, ...] = ()  # that its family names


@dataclass(frozen=True, slots=True)
class ScrapedLine:
    """One line; `statistics` are those of `gateway/line/{line}`, at most about a second old."""

    name: str
    statistics: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ScrapedGateway:
    """The gateway whole; times are seconds since 1970, UTC."""

    name: str
    version: str
    contract: int
    now_s: float
    started_s: float
    is_connected: bool  # to the broker
    outbox: Mapping[str, Any]  # the statistics of `gateway/outbox`
    is_clock_synchronised: bool
    streams: int | None  # open status pages; None: no page is served
    loops: Mapping[str, Delays]  # by loop, how late it was
    lines: tuple[ScrapedLine, ...]
    starters: tuple[ScrapedStarter, ...]


class MetricsSource(Protocol):
    """The gateway as the metrics see it; on the application's loop."""

    def scraped(self) -> ScrapedGateway:
        """Return how everything is now; at once, without asking any line."""
