"""Commands of one line are served a few at a time, in order; those that are not served in time expire."""

from __future__ import annotations

import asyncio
from collections import Counter

from gateway.records import Phase
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from gateway.system.rate_limits import Rate
from tests.starters.large_line import START_PDU, large_line
from tests.starters.rig import virtually

TTL_S = 5.0
MANY = PolicySettings(limits=RateLimits(client=Rate(1000.0, 1000), everyone=Rate(1000.0, 1000)))


@virtually
async def test_32_starts_at_once_on_an_over_full_line_are_carried_out_or_expire_in_their_time() -> None:
    async with large_line(80, every_s=0.0, baud=9600, settings=MANY) as here:
        await asyncio.sleep(60.0)
        asked_s = here.clock.now_s()
        for address in range(1, 33):
            here.submit("start", f"s{address}", address, expires_s=asked_s + TTL_S)
        await asyncio.sleep(30.0)

        ends = {address: here.end(f"s{address}", address) for address in range(1, 33)}
        codes = Counter(end.code for _, end in ends.values())
        assert set(codes) <= {"ok", "expired"}
        assert codes["ok"] >= 8
        expired = [(at_s, end) for at_s, end in ends.values() if end.code == "expired"]
        assert all(end.phase is Phase.REJECTED and at_s <= asked_s + TTL_S + 0.1 for at_s, end in expired)
        frames_s = {address: here.frames(address, START_PDU) for address in ends}
        assert all(len(frames_s[each]) == (ends[each][1].code == "ok") for each in ends)
        assert all(
            at_s <= asked_s + TTL_S + here.bound_s for times_s in frames_s.values() for at_s in times_s
        )
