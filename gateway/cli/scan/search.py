"""The search of `scan`: rates, framings and addresses in the order of likelihood, by reads only.

Rule of the search: nothing is written, and only FC43, FC03 and FC04 are sent. A valid request starts the
communication watchdogs of some starters (ssw900 C8.2.5), so those found with one are asked again in time as
long as the search is at their rate.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gateway.contract import CommandError
from gateway.errors import PortError
from gateway.families import Identity, Profile, Variant, Watchdog, diagnosis, reading
from gateway.line import Answered, Garbled, Outcome, PortOpener, Silent, Survey, silent_cost_s
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.starters import Ask, read_in_bulk

BAUDS = (19200, 9600, 38400, 57600)  # what the manuals name
FRAMINGS = ("8E1", "8N2", "8O1", "8N1", "8E2", "8O2")
LIKELY_FIRST = ((19200, "8E1"), (9600, "8N2"), (19200, "8N2"), (9600, "8E1"), (38400, "8E1"), (38400, "8N2"))
LIKELY_ADDRESSES = range(1, 17)  # tried at every setting before the others
ADDRESSES = range(1, 248)

# VB01 of SSW-06 and SSW-07; others answer it with an exception, and an exception is an answer.
_PROBE = ReadHoldingRegisters(5001, 1)
PROBES: tuple[Request, ...] = (
    _PROBE,
    ReadDeviceIdentification(read_code=1, object_id=0),
    ReadInputRegisters(0, 1),
    ReadHoldingRegisters(5000, 1),
)
_SLOWEST_REPLY_S = 0.1  # of a unit that is there
_WATCHDOG_SHARE = 1 / 3  # of its time, after which a unit is asked again
# Between attempts to open the port again: a serial server that takes one connection at a time, or an adapter
# that was unplugged for a moment, needs some time before it can be opened again.
_REOPEN_AFTER_S = (0.2, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class Find:
    """One address that answers; `profile` is None when it is no starter of a known family."""

    address: int
    timing: LineTiming
    profile: Profile | None
    identity: Identity
    watchdogs: tuple[Watchdog, ...] = ()


@dataclass(frozen=True, slots=True)
class Step:
    """How far the search is."""

    share: float
    left_s: float
    timing: LineTiming
    address: int


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """What is searched, and how."""

    timings: tuple[LineTiming, ...]
    addresses: tuple[int, ...]
    response_time_s: float = 0.05
    is_thorough: bool = False  # ask every address with every request
    goes_on: bool = False  # to the other settings although something was found


def timings_in_order(bauds: Sequence[int], framings: Sequence[str]) -> tuple[LineTiming, ...]:
    """Return all combinations, the likeliest first."""
    pairs = [(baud, framing) for framing in framings for baud in bauds]
    first = [pair for pair in LIKELY_FIRST if pair in pairs]
    ordered = dict.fromkeys((*first, *pairs))
    return tuple(LineTiming(baud, Framing.parse(framing)) for baud, framing in ordered)


def why_not(profile: Profile, timing: LineTiming) -> str:
    """Return why a family cannot be on a line of this setting, "" when it can."""
    if profile.bauds and timing.baud not in profile.bauds:
        return f"{profile.title} knows no {timing.baud} bit/s"
    if str(timing.framing) not in profile.framings:
        return f"{profile.title} knows no framing {timing.framing}"
    return ""


class Search:
    """One search; `open_with` gives the port at a timing."""

    def __init__(
        self,
        settings: SearchSettings,
        open_with: Callable[[LineTiming], PortOpener],
        *,
        on_step: Callable[[Step], None],
        on_find: Callable[[Find], None],
    ) -> None:
        self._settings = settings
        self._open_with = open_with
        self._on_step = on_step
        self._on_find = on_find
        self._due: dict[int, tuple[float, float]] = {}  # by address: when to ask again, and how often
        self._legs = list(_legs(settings))
        self._probes = PROBES if settings.is_thorough else PROBES[:1]
        self._spent_s = 0.0
        self._was_open = False  # the port, at least once

    async def run(self) -> list[Find]:
        """Return what answers; PortError when the port cannot be had."""
        found: list[Find] = []
        while self._legs:
            timing, addresses = self._legs.pop(0)
            here = await self._walk(timing, addresses)
            found += here
            is_settled = any(find.profile is not None and not why_not(find.profile, timing) for find in here)
            if is_settled and not self._settings.goes_on:  # all units of a line have one setting
                self._legs = [leg for leg in self._legs if leg[0] == timing]
        return found

    async def _walk(self, timing: LineTiming, addresses: tuple[int, ...]) -> list[Find]:
        """Return who answers at one setting; a port that is lost meanwhile is opened again."""
        found: list[Find] = []
        left = deque(enumerate(addresses))
        waits_s = iter(_REOPEN_AFTER_S)
        self._due.clear()
        while left:
            before = len(left)
            try:
                async with Survey(self._open_with(timing), timing) as survey:
                    self._was_open = True
                    while left:
                        self._report_step(timing, addresses, left[0][0])
                        await self._keep_quiet(survey)
                        find = await self._look(survey, left[0][1])
                        left.popleft()
                        if find is not None:
                            found.append(find)
                            self._on_find(find)
                            self._watch(find)
            except PortError:
                if len(left) < before:  # it did work for a while
                    waits_s = iter(_REOPEN_AFTER_S)
                wait_s = next(waits_s, None)
                if wait_s is None or not self._was_open:
                    raise
                await asyncio.sleep(wait_s)
        self._spent_s += len(addresses) * self._cost_s(timing)
        return found

    def _report_step(self, timing: LineTiming, addresses: tuple[int, ...], place: int) -> None:
        cost_s = self._cost_s(timing)
        left_s = (len(addresses) - place) * cost_s + sum(
            len(theirs) * self._cost_s(its) for its, theirs in self._legs
        )
        done_s = self._spent_s + place * cost_s
        self._on_step(Step(done_s / (done_s + left_s), left_s, timing, addresses[place]))

    def _cost_s(self, timing: LineTiming) -> float:
        """Return the time that an address without a device takes."""
        response_time_s = self._settings.response_time_s
        return sum(silent_cost_s(each, timing, response_time_s=response_time_s) for each in self._probes)

    async def _look(self, survey: Survey, address: int) -> Find | None:
        garbled = ""
        for probe in self._probes:
            outcome = await self._ask_twice(survey, address, probe)
            match outcome:
                case Silent():
                    continue
                case Garbled():
                    garbled = outcome.reason
                case _:
                    return await self._identify(survey, address)
        if not garbled:
            return None
        reason = f"something answers, but not in Modbus ({garbled}): two units, or another rate or framing"
        return Find(address, survey.timing, None, Identity(reason=reason))

    async def _ask_twice(self, survey: Survey, address: int, probe: Request) -> Outcome:
        """Send a request, and once more when the reply was corrupted."""
        outcome = await survey.ask(address, probe, response_time_s=self._settings.response_time_s)
        if isinstance(outcome, Garbled):
            outcome = await survey.ask(address, probe, response_time_s=_SLOWEST_REPLY_S)
        return outcome

    async def _identify(self, survey: Survey, address: int) -> Find:
        """Ask what each family asks, until one of them is proved."""
        asked: dict[Request, Outcome] = {}

        async def ask(request: Request) -> Outcome:
            response_time_s = max(self._settings.response_time_s, _SLOWEST_REPLY_S)
            if not isinstance(asked.get(request), Answered):
                asked[request] = await survey.ask(address, request, response_time_s=response_time_s)
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

    def _watch(self, find: Find) -> None:
        if find.watchdogs:
            every_s = find.watchdogs[0].after_s * _WATCHDOG_SHARE
            self._due[find.address] = (asyncio.get_running_loop().time() + every_s, every_s)

    async def _keep_quiet(self, survey: Survey) -> None:
        """Ask those units again whose watchdog would act before the search is over."""
        for address, (due_s, every_s) in tuple(self._due.items()):
            now_s = asyncio.get_running_loop().time()
            if now_s >= due_s:
                self._due[address] = (now_s + every_s, every_s)
                await survey.ask(address, _PROBE, response_time_s=_SLOWEST_REPLY_S)


def _legs(settings: SearchSettings) -> Iterator[tuple[LineTiming, tuple[int, ...]]]:
    """Yield what to search in which order: the likely addresses of all settings first."""
    likely = tuple(address for address in settings.addresses if address in LIKELY_ADDRESSES)
    others = tuple(address for address in settings.addresses if address not in LIKELY_ADDRESSES)
    for addresses in (likely, others):
        yield from ((timing, addresses) for timing in settings.timings if addresses)
