"""The search of `scan`: rates, framings and addresses in the order of likelihood, by reads only.

Rule of the search: nothing is written, and only FC43, FC03 and FC04 are sent. A valid request starts the
communication watchdogs of some starters (ssw900 C8.2.5), so those found with one are asked again in time as
long as the search is at their rate.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gateway.cli.command import Progress
from gateway.contract import CommandError
from gateway.errors import PortError
from gateway.families import Identity, Profile, Variant, Watchdog, diagnosis, reading
from gateway.line import Answered, Garbled, Outcome, PortOpener, Silent, Survey
from gateway.modbus import Framing, LineTiming, ReadHoldingRegisters, Request
from gateway.starters import Ask, read_in_bulk

BAUDS = (19200, 9600, 38400, 57600)  # what the manuals name
FRAMINGS = ("8E1", "8N2", "8O1", "8N1", "8E2", "8O2")
LIKELY_FIRST = ((19200, "8E1"), (9600, "8N2"), (19200, "8N2"), (9600, "8E1"), (38400, "8E1"), (38400, "8N2"))
LIKELY_ADDRESSES = range(1, 17)  # tried at every setting before the others
ADDRESSES = range(1, 248)

# VB01 of SSW-06 and SSW-07; others answer it with an exception, and an exception is an answer.
PROBE = ReadHoldingRegisters(5001, 1)
_SLOWEST_REPLY_S = 0.1  # of a unit that is there
_WATCHDOG_SHARE = 1 / 3  # of its time, after which a unit is asked again
# A serial server that takes one connection at a time, or an adapter that was unplugged for a moment, needs
# some time before it can be opened again.
_REOPENED_AFTER_S, _REOPENED_TIMES = 1.5, 5


@dataclass(frozen=True, slots=True)
class Find:
    """One address that answers; `profile` is None when it is no starter of a known family."""

    address: int
    timing: LineTiming
    profile: Profile | None
    identity: Identity
    watchdogs: tuple[Watchdog, ...] = ()

    @property
    def why_not(self) -> str:
        """Return why this family cannot be on a line of this setting; "" when it can, or is not known."""
        profile, timing = self.profile, self.timing
        if profile is not None and profile.bauds and timing.baud not in profile.bauds:
            return f"{profile.title} knows no {timing.baud} bit/s"
        if profile is not None and str(timing.framing) not in profile.framings:
            return f"{profile.title} knows no framing {timing.framing}"
        return ""

    @property
    def described(self) -> str:
        """Return in a line who answers, in characters that harm no terminal."""
        said = self.identity
        text = f"no known starter: {said.reason}"
        if self.profile is not None:
            facts = {"": said.model or self.profile.title, "firmware ": said.firmware, "serial ": said.serial}
            text = ", ".join(f"{name}{fact}" for name, fact in facts.items() if fact)
        return "".join(char if " " <= char <= "~" else "?" for char in text)


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """What is searched, and how."""

    timings: tuple[LineTiming, ...]
    addresses: tuple[int, ...]
    response_time_s: float = 0.05
    goes_on: bool = False  # to the other settings although something was found


def timings_in_order(bauds: Sequence[int], framings: Sequence[str]) -> tuple[LineTiming, ...]:
    """Return all combinations, the likeliest first."""
    pairs = [(baud, framing) for framing in framings for baud in bauds]
    first = [pair for pair in LIKELY_FIRST if pair in pairs]
    ordered = dict.fromkeys((*first, *pairs))
    return tuple(LineTiming(baud, Framing.parse(framing)) for baud, framing in ordered)


class Search:
    """One search; `open_with` gives the port at a timing."""

    def __init__(
        self, settings: SearchSettings, open_with: Callable[[LineTiming], PortOpener], progress: Progress
    ) -> None:
        self._settings = settings
        self._open_with = open_with
        self._progress = progress
        self._left = deque(  # the likely addresses of all settings first
            (timing, address)
            for is_likely in (True, False)
            for timing in settings.timings
            for address in settings.addresses
            if (address in LIKELY_ADDRESSES) is is_likely
        )
        self._done = 0
        self._attempts = 0  # that are left; a port that has never been open is not waited for
        self._due: dict[tuple[LineTiming, int], tuple[float, float]] = {}  # when to ask again, and how often

    async def run(self) -> list[Find]:
        """Return what answers; a port that is lost meanwhile is opened again. PortError without one."""
        found = list[Find]()
        while self._left:
            timing = self._left[0][0]
            try:
                async with Survey(self._open_with(timing), timing) as survey:
                    while self._left and self._left[0][0] == timing:
                        self._attempts = _REOPENED_TIMES
                        if (find := await self._step(survey)) is not None:
                            found.append(find)
            except PortError:
                if not self._attempts:
                    raise
                self._attempts -= 1
                await asyncio.sleep(_REOPENED_AFTER_S)
        return found

    async def _step(self, survey: Survey) -> Find | None:
        """Look at one address; after the first starter only this setting is left: a line has one."""
        timing, address = self._left[0]
        share = self._done / (self._done + len(self._left))
        self._progress.show(share, f"{timing.baud} {timing.framing} address {address}")
        await self._keep_quiet(survey)
        find = await self._look(survey, address)
        self._left.popleft()
        self._done += 1
        if find is not None:
            self._progress.say(f"address {address} at {timing.baud} {timing.framing}: {find.described}")
            for watchdog in find.watchdogs[:1]:
                every_s = watchdog.after_s * _WATCHDOG_SHARE
                self._due[timing, address] = asyncio.get_running_loop().time() + every_s, every_s
            if find.profile is not None and not find.why_not and not self._settings.goes_on:
                self._left = deque(step for step in self._left if step[0] == timing)
        return find

    async def _look(self, survey: Survey, address: int) -> Find | None:
        outcome = await survey.ask(address, PROBE, response_time_s=self._settings.response_time_s)
        if isinstance(outcome, Garbled):  # once more
            outcome = await survey.ask(address, PROBE, response_time_s=_SLOWEST_REPLY_S)
        if isinstance(outcome, Silent):
            return None
        if not isinstance(outcome, Garbled):
            return await self._identify(survey, address)
        what = f"something answers, but not in Modbus ({outcome.reason})"
        reason = f"{what}: two units, or another rate or framing"
        return Find(address, survey.timing, None, Identity(reason=reason))

    async def _identify(self, survey: Survey, address: int) -> Find:
        """Ask what each family asks, until one of them is proved."""
        asked: dict[Request, Outcome] = {}

        async def ask(request: Request) -> Outcome:
            if not isinstance(asked.get(request), Answered):
                within_s = max(self._settings.response_time_s, _SLOWEST_REPLY_S)
                asked[request] = await survey.ask(address, request, response_time_s=within_s)
            return asked[request]

        reasons: dict[str, None] = {}
        for profile in diagnosis.candidates():
            answers = {
                question.tag: outcome.value
                for question in diagnosis.identify_requests(profile)
                if isinstance(outcome := await ask(question.request), Answered)
            }
            identity = diagnosis.identify(profile, answers)
            if diagnosis.matches(profile, identity):
                watchdogs = await self._watchdogs(ask, profile, identity)
                return Find(address, survey.timing, profile, identity, watchdogs)
            reasons[identity.reason] = None
        return Find(address, survey.timing, None, Identity(reason="; ".join(reasons)))

    async def _watchdogs(self, ask: Ask, profile: Profile, identity: Identity) -> tuple[Watchdog, ...]:
        reads = reading.bulk_reads(profile, diagnosis.watchdog_codes(profile))
        try:
            rows = (await read_in_bulk(ask, profile, reads)).rows
        except CommandError:  # it has fallen silent; it is a find all the same
            return ()
        return diagnosis.watchdogs(profile, Variant(slot=identity.slot), rows)

    async def _keep_quiet(self, survey: Survey) -> None:
        """Ask those units again whose watchdog would act before the search is over."""
        now_s = asyncio.get_running_loop().time()
        for (timing, address), (due_s, every_s) in tuple(self._due.items()):
            if timing == survey.timing and now_s >= due_s:
                self._due[timing, address] = (now_s + every_s, every_s)
                await survey.ask(address, PROBE, response_time_s=_SLOWEST_REPLY_S)
