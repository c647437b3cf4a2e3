"""What a plugin is, and the gateway as plugins see it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gateway.config import Config
from gateway.contract import Latest, PublishEvent, Record, RecordWriter
from gateway.line import LineClient
from gateway.mqtt import Message
from gateway.starters import Commands, Policy, StarterTelemetry, Tokens
from gateway.store import Documents, HistoryRow
from gateway.system.clock import Clock
from gateway.system.stalls import LagMeter
from gateway.system.supervised import InThread


class Plugin(Protocol):
    """A plugin while it runs; all calls on the app's loop."""

    def put(self, record: Record) -> None:
        """Take a record; of values only the newest, all else in order; returns at once."""

    def reconfigure(self, settings: Any, /) -> None:
        """Go on with other settings."""

    async def run(self) -> None:
        """Serve until cancelled, then end in order; one that ends by itself is made again."""


class PluginSite(Protocol):
    """The configuration with what was read and computed from it."""

    @property
    def config(self) -> Config:
        """The configuration."""

    @property
    def folder(self) -> Path:
        """The configuration's: relative paths begin there."""

    @property
    def path(self) -> Path | None:
        """The configuration's file."""

    @property
    def state_dir(self) -> Path:
        """Where the gateway stores what the next run needs."""

    @property
    def computed(self) -> Mapping[str, Mapping[str, Any]]:
        """By line its computed worst-case statistics."""

    @property
    def secrets(self) -> Mapping[str, str | None]:
        """By table its password or token."""


ShownStarter = StarterTelemetry  # one starter, as plugins see it


class Mqtt(Protocol):
    """The gateway's connection to its broker, for messages of a plugin's own."""

    def announce(self, message: Message) -> None:
        """Publish a message on a topic that is none of the gateway's own."""

    def retained(self, topic: str) -> Message | None:
        """Return the newest message of a retained topic; None once the broker has been made to forget it."""

    def listen(self, topic: str, on_message: Callable[[bytes], None]) -> None:
        """Have the payloads of one more topic; none of them is ever a command."""

    def unlisten(self, topic: str) -> None:
        """Stop taking messages of a topic of `listen`."""

    def is_connected(self) -> bool:
        """Return whether messages go out now."""

    def facts(self) -> dict[str, Any]:
        """Return how the gateway and its connection are, by Sparkplug's names."""

    def statistics(self) -> dict[str, Any]:
        """Return what waits for the broker."""


class ValueSeries(Protocol):
    """Values over time."""

    def points(self, starter: str) -> list[str]:
        """Return the points that are known, the current first."""

    async def over(self, starter: str, point: str, *, span_s: float, steps: int) -> Any:
        """Return the `least`, the `most` and the `last` of each step up to now; None where not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gateway:
    """The gateway as its plugins see it; on the app's loop."""

    name: str
    clock: Clock
    records: RecordWriter
    publish_event: PublishEvent
    latest: Latest
    commands: Commands
    tokens: Tokens
    policy: Policy
    documents: Documents
    starters: Mapping[str, ShownStarter]
    lines: Callable[[], Mapping[str, LineClient]]  # those of the present configuration
    mqtt: Mqtt
    started_s: float  # UTC
    clock_doubt: Callable[[], str | None]
    progress: Callable[[], Mapping[str, int]]  # of the lines' loops
    loops: Mapping[str, LagMeter]
    stored: Callable[[str, Sequence[str]], Awaitable[list[HistoryRow]]]  # of a starter's history
    series: ValueSeries
    plugin: Callable[[str], Plugin | None]  # another one that runs now, by its name
    make_web_server: Callable[..., Any] | None
    in_thread: InThread
