"""What a starter is by configuration, what its identification adds to that, and the one way to ask it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from math import inf

from gateway.families.devices.device import Identity
from gateway.families.profile.schema import Profile, Variant
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Outcome
from gateway.line.rtu.timeouts import ALLOWANCE_S
from gateway.line.scheduler.requests import Priority
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming
from gateway.modbus.writes import WriteRegisters

Asked = asyncio.Future[Outcome]  # what becomes of a request; cancelled, it is withdrawn while it waits

LEARNT_MINIMUM_S = 0.005
UNSTATED_MINIMUM_S = 0.030  # where the manual names no time, ours is a guess on the long side


@dataclass(frozen=True, slots=True)
class StarterSetup:
    """One starter as configured, in plain values."""

    name: str
    line: str
    address: int  # 1..247
    profile: Profile
    variant: Variant  # what the configuration says of it; it wins over what the starter says
    every_s: float = 1.0  # status and electrical values; 0 = as often as the line allows
    response_time_s: float | None = None  # None: as the manual says
    is_enabled: bool = True
    watchdog_s: float | None = None  # of the communication, as set in the starter; 0: off; None: not stated
    timing: LineTiming | None = None  # of its line; None: reads are not joined by what they cost
    allowance_s: float = ALLOWANCE_S  # of its line: what adapter and machine add to a reply's way
    has_fast_words: bool = False  # its points are mapped so that one request reads all (SSW900)
    learns_response_times: bool = False  # waits for it follow what it has shown
    edition: int = 0  # of the configuration: a late answer to a poll of an earlier one is ignored

    def response_time_of(self, request: Request) -> float:
        """Return the longest time from a request's end to its reply's first byte."""
        timing = self.profile.timing
        if not request.is_write:
            return self.response_time_s or timing.read_s
        allowed_s = self.response_time_s or timing.write_s
        if isinstance(
            request, WriteRegisters
        ):  # FC16 takes its time per register (ssw07 5.3.1, ssw06-es 5.3.1)
            return max(allowed_s, timing.write_per_register_s * len(request.words))
        return allowed_s

    def shortest_response_of(self, request: Request) -> float | None:
        """Return down to what the wait for a reply may be learnt; None where the manual's time stands."""
        if request.is_write:
            return None
        if self.learns_response_times:
            return LEARNT_MINIMUM_S
        is_ours = not self.profile.timing.is_stated and self.response_time_s is None
        return UNSTATED_MINIMUM_S if is_ours else None


def ask(
    line: LineClient,
    setup: StarterSetup,
    request: Request,
    *,
    lane: Priority,
    until_s: float = inf,
    is_literal: bool = False,
) -> Asked:
    """Send a request to a starter, not later than `until_s`; what `is_literal` in no other form."""
    return line.transact(
        setup.address,
        request,
        response_time_s=setup.response_time_of(request),
        lane=lane,
        until_s=until_s,
        is_literal=is_literal,
    )


def merged(configured: Variant, identity: Identity) -> Variant:
    """Return what is known of a starter, where the configuration is silent from its own identification."""
    return Variant(
        model=configured.model or identity.model,
        firmware=configured.firmware or identity.firmware,
        rated_current_a=configured.rated_current_a or identity.rated_current_a,
        slot=configured.slot or identity.slot,
    )
