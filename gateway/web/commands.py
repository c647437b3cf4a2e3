"""A command's phases on their way to the request that sent it, found by its correlation."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.contract import Phase

MAX_BODY_BYTES = 4096  # as over MQTT
ANSWER_WITHIN_S = 10.0
MOST_PHASES = 64  # of a group its members' as well


class Phases:
    """What has become of one command so far."""

    def __init__(self, starter: str) -> None:
        self.payloads: list[bytes] = []
        self._prefix = f"result/{starter}/"  # of a group, its members' results have other topics
        self._final = asyncio.Event()

    def add(self, name: str, payload: bytes) -> None:
        """Take a result as MQTT gets it; `name` is its topic below the base."""
        if len(self.payloads) < MOST_PHASES:
            self.payloads.append(payload)
        if name.startswith(self._prefix) and Phase(json.loads(payload)["phase"]).is_final:
            self._final.set()

    async def until_final(self) -> bool:
        """Return whether the final phase came in time."""
        try:
            async with asyncio.timeout(ANSWER_WITHIN_S):
                await self._final.wait()
        except TimeoutError:
            return False
        return True


class PendingCommands:
    """The commands whose requests wait for an answer; on the application's loop."""

    def __init__(self) -> None:
        self._pending: dict[bytes, Phases] = {}

    @contextmanager
    def expect(self, correlation: bytes, starter: str) -> Iterator[Phases]:
        """Collect the phases of one command."""
        phases = self._pending[correlation] = Phases(starter)
        try:
            yield phases
        finally:
            del self._pending[correlation]

    def put(self, correlation: bytes | None, name: str, payload: bytes) -> None:
        """Take a result, if a request waits for it."""
        phases = self._pending.get(correlation or b"")
        if phases is not None:
            phases.add(name, payload)
