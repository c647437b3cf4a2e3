"""One starter on a fake line, read by hand, with and without a dispatcher."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.scheduler.requests import Priority
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import RecordWriter
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.telemetry import StarterTelemetry
from gateway.starters.telemetry.transitions import PublishedFaults
from tests.starters.fakes import (
    AT_SPEED,
    READY,
    RUN_COIL,
    VB01,
    VB03,
    FakeLineClient,
    RecordingSink,
    Sent,
    make_unit,
)
from tests.virtual_time import VirtualClock, run_virtually


def virtually(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Let an async test run to its end in virtual time."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        run_virtually(test(*args, **kwargs))

    return run


@dataclass
class Rig:
    """One starter of a family on a fake line, read by hand: `poll` is one round of all its polls."""

    family: str = "ssw07"
    variant: Variant = field(default_factory=Variant)
    every_s: float = 1.0
    is_enabled: bool = True
    published_faults: PublishedFaults | None = None

    def __post_init__(self) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.sink = RecordingSink()
        self.records = RecordWriter(self.sink, self.clock)
        self.unit = make_unit(self.family)
        self.line = FakeLineClient(self.unit)
        self.setup = StarterSetup(
            name="pump-1",
            line="pumps",
            address=7,
            profile=load_profile(self.family),
            variant=self.variant,
            every_s=self.every_s,
            is_enabled=self.is_enabled,
        )
        self.telemetry = StarterTelemetry(
            self.setup,
            line=self.line,
            records=self.records,
            published_faults=self.published_faults,
        )
        for poll in self.telemetry.polls():
            self.line.add_poll(poll)

    async def online(self) -> Rig:
        """Start, answer every poll once and be identified; then forget what was said."""
        self.telemetry.start()
        self.poll()
        await asyncio.sleep(0.5)
        self.poll()
        self.sink.clear()
        self.line.sent.clear()
        return self

    def poll(self, *keys: str) -> None:
        """Answer these polls (or all) now, in no time."""
        for key in keys or tuple(self.line.polls):
            if key not in self.line.polls:
                continue  # another answer of this round has replaced it
            outcome = self.line.outcome_of(self.line.polls[key].request, at_s=self.clock.now_s())
            self.telemetry.on_poll(key, outcome)

    async def poll_for(self, seconds: float) -> None:
        """Answer all polls again and again, as often as configured for the status."""
        until_s = self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            self.poll()
            await asyncio.sleep(self.every_s)

    def lose(self, reason: str = "no reply", frames: tuple[str, ...] = ()) -> None:
        self.telemetry.on_unit(is_answering=False, reason=reason, frames=frames)


async def is_proved(*, lane: Priority) -> None:
    """Stand for the questions before a write."""


@dataclass
class CommandRig(Rig):
    """The same with a dispatcher; alice may do everything, victor only stop."""

    operators: tuple[Operator, ...] = (
        Operator("alice", ("*",), ("*",)),
        Operator("victor", ("stop",), ("*",)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        rights = Rights(self.operators)
        self.tasks: list[asyncio.Future[None]] = []  # which the tests keep alive
        self.stood_still_s = -inf  # when the latest standstill ended
        self.dispatcher = Dispatcher(
            {self.setup.name: self.telemetry},
            rights=rights,
            records=self.records,
            stood_still_s=lambda: self.stood_still_s,
        )
        self.telemetry.prove = is_proved  # type: ignore[method-assign]  # a command's own requests are counted
        if self.family in ("ssw06", "ssw07"):
            self.unit.on_write = self._obey

    def submit(self, verb: str, id_: str | None = "1", **more: Any) -> None:
        fields = {"starter": "pump-1", "client": "alice", "args": {}, **more}
        self.dispatcher.submit(CommandRequest(verb=verb, id=id_, received_s=self.clock.now_s(), **fields))

    def starts(self) -> int:
        """Return how many start frames went out."""
        return sum(isinstance(w, WriteCoil) and w.address == RUN_COIL and w.is_on for w in self.line.writes)

    def stops(self) -> list[Sent]:
        """Return the stop frames that went out."""
        return [
            sent
            for sent in self.line.sent
            if isinstance(sent.request, WriteCoil)
            and sent.request.address == RUN_COIL
            and not sent.request.is_on
        ]

    def _obey(self, request: Request) -> None:
        """Run at once and stop at once, as the coil says, or the masked word of the SSW-06."""
        if isinstance(request, WriteCoil) and request.address == RUN_COIL:
            self.unit.holding[VB01] = AT_SPEED if request.is_on else READY
        if isinstance(request, WriteRegister) and request.address == VB03 and request.word & 0x0100:
            self.unit.holding[VB01] = AT_SPEED if request.word & 0x0001 else READY
