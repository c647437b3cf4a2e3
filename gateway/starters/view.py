"""What a command needs of a starter."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Protocol

from gateway.families import Identity, Profile, Variant
from gateway.line import LineClient, Priority
from gateway.modbus import Request
from gateway.starters.identity import IdentityStatus
from gateway.starters.setup import Asked, StarterSetup
from gateway.starters.state import Emitter, Snapshot


class StarterWire(Protocol):
    """One starter, as far as it is asked, written to and read."""

    @property
    def setup(self) -> StarterSetup:
        """The starter as configured."""

    @property
    def profile(self) -> Profile:
        """Its family."""

    @property
    def variant(self) -> Variant:
        """What is known of it by configuration and identification."""

    def ask(self, request: Request, *, lane: Priority, until_s: float = inf) -> Asked:
        """Send it a request, not later than `until_s`; cancelled, it is withdrawn while it waits."""

    def take_rows(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        """Record rows that were just read for a command; they are published once the command waits again."""


class StarterIo(StarterWire, Protocol):
    """One starter, as the dispatcher sees it; `StarterTelemetry` is one."""

    @property
    def line(self) -> LineClient:
        """The line it is on."""

    @property
    def snapshot(self) -> Snapshot:
        """What was read of it last."""

    @property
    def emitter(self) -> Emitter:
        """Its emitter, for events."""

    @property
    def is_answering(self) -> bool:
        """Whether it is online."""

    @property
    def identity(self) -> Identity:
        """What the device said about itself."""

    @property
    def identity_standing(self) -> IdentityStatus:
        """Whether the device has proved to be the configured family."""

    @property
    def identity_reason(self) -> str:
        """In words why the identity is not matching."""

    @property
    def contradiction(self) -> str:
        """In what the device contradicts the configuration, so that its values mean nothing."""

    def republish_state(self) -> None:
        """Publish its state again, because its lock has changed."""
