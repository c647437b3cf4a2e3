"""One starter on a fake line, read by hand, with a dispatcher."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Coroutine
from typing import Any

from gateway.contract import CommandRequest, Operator, RecordWriter
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil
from gateway.starters.command import Dispatcher
from gateway.starters.policy.rights import Rights
from gateway.starters.setup import StarterSetup
from gateway.starters.starter import StarterTelemetry
from tests.starters.fakes import (
    AT_SPEED,
    READY,
    RUN_COIL,
    VB01,
    FakeLineClient,
    RecordingSink,
    make_unit,
)
from tests.virtual_time import VirtualClock, run_virtually


def virtually(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Let an async test run to its end in virtual time."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        run_virtually(test(*args, **kwargs))

    return run


class CommandRig:
    """An SSW-07 on a fake line, read by hand, with a dispatcher; alice may do everything.

    `poll` is one round of all its polls.
    """

    def __init__(self) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.sink = RecordingSink()
        self.records = RecordWriter(self.sink, self.clock)
        self.unit = make_unit()
        self.unit.on_write = self._obey
        self.line = FakeLineClient(self.unit)
        self.setup = StarterSetup("pump-1", "pumps", 7, load_profile("ssw07"), Variant())
        self.telemetry = StarterTelemetry(self.setup, line=self.line, records=self.records)
        for poll in self.telemetry.polls():
            self.line.add_poll(poll)
        self.dispatcher = Dispatcher(
            {self.setup.name: self.telemetry},
            rights=Rights((Operator("alice", ("*",), ("*",)),)),
            records=self.records,
        )

    async def online(self) -> CommandRig:
        """Start, answer every poll once and be identified; then forget what was said."""
        self.telemetry.start()
        self.poll()
        await asyncio.sleep(0.5)
        self.poll()
        self.sink.clear()
        self.line.sent.clear()
        return self

    def poll(self) -> None:
        """Answer all polls now, in no time."""
        for key in tuple(self.line.polls):
            if key not in self.line.polls:
                continue  # another answer of this round has replaced it
            outcome = self.line.outcome_of(self.line.polls[key].request, at_s=self.clock.now_s())
            self.telemetry.on_poll(key, outcome)

    async def poll_for(self, seconds: float) -> None:
        """Answer all polls again and again, once a second."""
        until_s = self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            self.poll()
            await asyncio.sleep(1.0)

    def submit(self, verb: str, id_: str | None = "1", **more: Any) -> None:
        fields = {"starter": "pump-1", "client": "alice", "args": {}, **more}
        self.dispatcher.submit(CommandRequest(verb=verb, id=id_, received_s=self.clock.now_s(), **fields))

    def _obey(self, request: Request) -> None:
        """Run at once and stop at once, as the coil says."""
        if isinstance(request, WriteCoil) and request.address == RUN_COIL:
            self.unit.holding[VB01] = AT_SPEED if request.is_on else READY
