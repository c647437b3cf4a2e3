"""Several starters, each on a fake line of its own, under one dispatcher with a policy and a memory."""

from __future__ import annotations

import asyncio
from typing import Any

from gateway.app.record_log import log_failure
from gateway.contract import CommandRequest, Operator, RecordBus, RecordWriter
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.start_rules import PolicySettings
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.starters.fakes import AT_SPEED, READY, RUN_COIL, VB01, FakeLineClient, RecordingSink, make_unit
from tests.starters.rig import is_proved
from tests.virtual_time import VirtualClock

OPERATORS = (
    Operator("alice", ("*",), ("*",)),
    Operator("bob", ("start", "stop", "read"), ("pump-1", "pump-2")),
    Operator("victor", ("stop",), ("pump-1",)),
)


class Machine:
    """One starter of the plant: its registers, its line, what is read of it."""

    def __init__(self, name: str, plant: Plant) -> None:
        self.unit = make_unit()
        self.unit.on_write = self._obey
        self.line = FakeLineClient(self.unit)
        setup = StarterSetup(name, self.line.name, 7, load_profile("ssw07"), Variant())
        self.telemetry = StarterTelemetry(
            setup,
            line=self.line,
            records=plant.records,
            lock_of=plant.policy.motor_history.lock_of,
        )
        self.telemetry.prove = is_proved  # type: ignore[method-assign]
        for poll in self.telemetry.polls():
            self.line.add_poll(poll)

    def poll(self) -> None:
        for key in tuple(self.line.polls):
            request = self.line.polls[key].request
            at_s = asyncio.get_running_loop().time()
            self.telemetry.on_poll(key, self.line.outcome_of(request, at_s=at_s))

    def _obey(self, request: Request) -> None:
        if isinstance(request, WriteCoil) and request.address == RUN_COIL:
            self.unit.holding[VB01] = AT_SPEED if request.is_on else READY


class Plant:
    """Three pumps on three lines."""

    def __init__(
        self,
        policy: PolicySettings | None = None,
    ) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.bus, self.sink = RecordBus(log_failure), RecordingSink()
        self.records = RecordWriter(self.bus, self.clock)
        names, rights = ("pump-1", "pump-2", "pump-3"), Rights(OPERATORS)
        self.policy = Policy(
            policy or PolicySettings(),
            names,
            rights=rights,
            records=self.records,
        )
        self.bus.connect(self.policy, self.sink)
        self.machines = {name: Machine(name, self) for name in names}
        self.dispatcher = Dispatcher(
            {name: machine.telemetry for name, machine in self.machines.items()},
            rights=rights,
            records=self.records,
            policy=self.policy,
        )

    async def online(self) -> Plant:
        """Be read and identified; then forget what was said."""
        for machine in self.machines.values():
            machine.telemetry.start()
            machine.poll()
        await asyncio.sleep(0.5)
        self.poll()
        self.sink.clear()
        for machine in self.machines.values():
            machine.line.sent.clear()
        return self

    def poll(self) -> None:
        for machine in self.machines.values():
            machine.poll()

    async def wait(self, seconds: float) -> None:
        """Let time pass while everything is polled every second."""
        until_s = self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            await asyncio.sleep(min(1.0, until_s - self.clock.now_s()))
            self.poll()

    def submit(self, verb: str, id_: str | None = "1", *, starter: str = "pump-1", **more: Any) -> None:
        fields = {"client": "alice", "args": {}, "received_s": self.clock.now_s(), **more}
        self.dispatcher.submit(CommandRequest(starter=starter, verb=verb, id=id_, **fields))

    def starts(self, starter: str = "pump-1") -> int:
        """Return how many start frames went out."""
        writes = self.machines[starter].line.writes
        return sum(isinstance(each, WriteCoil) and each.address == RUN_COIL and each.is_on for each in writes)
