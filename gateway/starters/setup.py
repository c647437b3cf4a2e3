"""What a starter is by configuration, which polls follow from it, and the one way to ask a starter."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from math import inf

from gateway.families import Identity, Profile, Variant, diagnosis, once_per_profile, other_reads, reading
from gateway.line import ALLOWANCE_S, Forms, LineClient, Outcome, Poll, Priority
from gateway.modbus import LineTiming, Request, WriteRegisters

Asked = asyncio.Future[Outcome]  # what becomes of a request; cancelled, it is withdrawn while it waits


@dataclass(frozen=True, slots=True)
class StarterSetup:
    """One starter as configured, in plain values."""

    name: str
    line: str
    address: int  # 1..247
    profile: Profile
    variant: Variant  # what the configuration says of it; it wins over what the starter says
    timing: LineTiming  # of its line
    every_s: float = 1.0  # status and electrical values; 0 = as often as the line allows
    response_time_s: float | None = None  # None: as the manual says
    is_enabled: bool = True
    watchdog_s: float | None = None  # of the communication, as set in the starter; 0: off; None: not stated
    allowance_s: float = ALLOWANCE_S  # of its line: what adapter and machine add to a reply's way
    title: str | None = None  # for people; None: its name
    edition: int = 0  # of the configuration: a late answer to a poll of an earlier one is ignored

    def response_time_of(self, request: Request) -> float:
        """Return the longest time from a request's end to its reply's first byte."""
        timing = self.profile.timing
        if not request.is_write:
            return self.response_time_s or timing.read_s
        allowed_s = self.response_time_s or timing.write_s
        if isinstance(request, WriteRegisters):  # its time is per register (ssw07 5.3.1, ssw06-es 5.3.1)
            return max(allowed_s, timing.write_per_register_s * len(request.words))
        return allowed_s

    def key_of(self, block: reading.Block) -> str:
        """Return the key of a block's poll."""
        edition = f"/{self.edition}" if self.edition else ""
        return f"{self.name}/{block.name}{edition}"

    def poll_of(self, block: reading.Block, *, every_s: float, limit_s: float | None = None) -> Poll:
        """Return the poll that reads a block; `limit_s` of the watchdog that it must keep from acting."""
        return Poll(
            key=self.key_of(block),
            unit=self.address,
            request=block.request,
            every_s=every_s,
            response_time_s=self.response_time_of(block.request),
            deadline_s=limit_s,
            group=block.group,
            is_urgent=block.group == "status",
            forms=forms_of(self.profile),
        )


def blocks_of(setup: StarterSetup, variant: Variant) -> tuple[reading.Block, ...]:
    """Return what is read of a starter of this variant, status first; nothing of a disabled one."""
    if not setup.is_enabled:
        return ()
    return reading.plan_blocks(setup.profile, variant, timing=setup.timing, every_s=setup.every_s)


def polls_of(setup: StarterSetup, limit_s: float | None = None) -> tuple[Poll, ...]:
    """Return the polls with which a starter's line begins, status first; none for a disabled starter.

    `limit_s` is the time of its watchdog where that is shorter than configured.
    """
    return tuple(
        setup.poll_of(block, every_s=block.period_s(setup.every_s), limit_s=limit_s or setup.watchdog_s)
        for block in blocks_of(setup, setup.variant)
    )


@once_per_profile
def forms_of(profile: Profile) -> Forms:
    """Return what else can be asked of the starters of a family, for their line."""
    return Forms(*other_reads(profile), diagnosis.decision_reads(profile))


def ask(
    line: LineClient,
    setup: StarterSetup,
    request: Request,
    *,
    lane: Priority,
    until_s: float = inf,
) -> Asked:
    """Send a request to a starter, not later than `until_s`."""
    return line.transact(
        setup.address,
        request,
        response_time_s=setup.response_time_of(request),
        lane=lane,
        until_s=until_s,
    )


def merged(configured: Variant, identity: Identity) -> Variant:
    """Return what is known of a starter, where the configuration is silent from its own identification.

    Where its accessory sits is the starter's to say: a stop in the other slot's word would stop nothing.
    """
    return Variant(
        model=configured.model or identity.model,
        firmware=configured.firmware or identity.firmware,
        rated_current_a=configured.rated_current_a or identity.rated_current_a,
        slot=identity.slot or configured.slot,
    )
