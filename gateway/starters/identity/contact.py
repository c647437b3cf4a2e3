"""The contact with one starter: its watchdog is read, then the device is asked who it is.

A watchdog counts from the first telegram that reaches the starter (ssw900 C8.2.5; ssw06-es and ssw07 2.4),
so it must be known before the line has come round once. FC43 comes last: a device that does not know it may
be silent for a while after it, so its tries are counted on over such a silence.

A device of another family is asked again soon, then ever less often: its answers may have been corrupted, or
the right one may be back without a silence. FC43 is put again only if it was answered. Such a device stays
what it is until an answer says otherwise, so that a stop does not change its words for a lost reply.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from functools import partial
from math import inf

from gateway.contract import CommandError, RecordWriter, ResultCode
from gateway.families import Identity, Profile, Question, device_of, diagnosis
from gateway.line import Garbled, LineClient, Outcome, Priority, Silent
from gateway.starters.identity.fingerprint import IdentityMismatch
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.identity.standing import (
    NAME,
    Answers,
    IdentityStatus,
    Standing,
    identity_of,
    judged,
    met,
    next_question,
    not_matching,
    silenced,
)
from gateway.starters.setup import StarterSetup, ask
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import SupervisedTask

PAUSES_S = (0.0, 2.0, 4.0)  # before the rounds: two misses in a row would make a unit count as silent
UNSENT_PAUSE_S = 2.0
FIRST_DOUBT_S, AGAIN_S = 2.0, 60.0  # after which another family is asked again: at first, and at the latest
NAME_AGAIN_S = 3600.0  # of a device that is read without a name
FROM_NAME_S = 60.0  # a silence within so long after FC43 may be its effect


class Contact:
    """Asks one starter; `read_rows` reads rows of it, `on_judged` is called once it is judged."""

    def __init__(
        self,
        setup: StarterSetup,
        line: LineClient,
        *,
        registry: IdentityRegistry,
        records: RecordWriter,
        read_rows: Callable[[Iterable[str], Priority], Awaitable[object]],
        on_judged: Callable[[], None],
    ) -> None:
        self.standing = Standing()
        self._setup = setup
        self._line = line
        self._registry = registry
        self._records = records
        self._read_rows = read_rows
        self._on_judged = on_judged
        self._task = SupervisedTask(f"first contact {setup.name}")
        self.cancel, self.close = self._task.cancel, self._task.close
        self._answers = Answers()  # FC43 counts as missed from when it is put until it is answered
        self._named_s = -inf  # when it was put last
        self._announced = ChangeDetector()  # what the latest event was about, until the starter matches

    def begin(self, *, is_known: bool) -> None:
        """Ask from the beginning; a watchdog that is known waits until all starters have been asked once."""
        self.standing = met(self.standing)
        self._task.begin(partial(self._meet, Priority.IDENTITY if is_known else Priority.WATCHDOG))

    def renew(self) -> None:
        """Ask again: the port was opened again, and another device may answer now."""
        self._answers = Answers()
        self.begin(is_known=True)

    def note_silence(self) -> None:
        """Record that the starter went silent, perhaps for its latest question; ask nothing any more."""
        self.cancel()
        is_its_effect = asyncio.get_running_loop().time() < self._named_s + FROM_NAME_S
        self._answers = self._answers.unnamed() if is_its_effect else Answers()
        self.standing = silenced(self.standing)

    def waiting(self) -> IdentityMismatch:
        """Return which change waits to be accepted; CommandError when none does."""
        if self.standing.mismatch is None:
            raise CommandError(ResultCode.NOTHING_TO_ACCEPT)
        return self.standing.mismatch

    def accept(self) -> IdentityMismatch:
        """Accept the device that answers as the right one; CommandError when no change waits for that."""
        mismatch = self.waiting()
        self._registry.accept(self._setup.name, mismatch)
        self._judge()
        self._announce()
        self._on_judged()
        return mismatch

    async def _meet(self, lane: Priority) -> None:
        """Read the watchdog, then ask until the device is identified."""
        profile = self._setup.profile
        await self._read_rows(device_of(profile).watchdog_rows, lane)  # if not now, then with the others
        doubt_s = FIRST_DOUBT_S
        while True:
            async for answers in interview(profile, self._answers, self._put):
                self._answers = answers
            before = self.standing
            self._judge()
            if (before.status, self.standing.status) == (IdentityStatus.MISMATCHED, IdentityStatus.UNKNOWN):
                # Its registers are the family's now: another device, which was not asked for its name yet.
                self.standing, self._answers = met(self.standing), Answers()
                continue
            self._announce()
            if self.standing != before:
                self._on_judged()
            if self.standing.status is IdentityStatus.MISMATCHED:
                await asyncio.sleep(doubt_s)
                doubt_s = min(2 * doubt_s, AGAIN_S)
                self._answers = self._answers.unnamed()
            elif self.standing.status is IdentityStatus.UNKNOWN:
                await asyncio.sleep(NAME_AGAIN_S if self.standing.is_readable else AGAIN_S)
                self._answers = Answers()
            else:
                return

    async def _put(self, question: Question) -> Outcome:
        if question.tag == NAME:
            self._answers, self._named_s = self._answers.missed(NAME), asyncio.get_running_loop().time()
        return await ask(self._line, self._setup, question.request, lane=Priority.IDENTITY)

    def _judge(self) -> None:
        profile, identity = self._setup.profile, identity_of(self._setup.profile, self._answers)
        diagnosis.stop_profile(profile, identity)  # loaded now, so that a stop need not wait for it
        is_family = diagnosis.matches(profile, identity)
        mismatch = self._registry.judge(self._setup, identity) if is_family else None
        self.standing = judged(self.standing, self._setup, self._answers, mismatch)

    def _announce(self) -> None:
        """Publish what holds the commands, unless the latest event was about the same."""
        event, status, seen = self.standing.event, self.standing.status, self.standing.identity
        if event is None:
            self._announced = ChangeDetector()
            return
        name = event.text if status is IdentityStatus.CHANGED else seen.family_seen or seen.model
        if self._announced.is_new((status, seen.slot, name)):
            self._records.event(self._setup.name, event)


async def interview(
    profile: Profile, answers: Answers, put: Callable[[Question], Awaitable[Outcome]]
) -> AsyncIterator[Answers]:
    """Put the open questions in rounds until none is open; yield the answers after each of them."""
    for round_, pause_s in enumerate(PAUSES_S, 1):
        if next_question(profile, answers) is None:
            return
        await asyncio.sleep(pause_s)
        while (question := next_question(profile, answers, round_)) is not None:
            outcome = await put(question)
            answers = answers.after(question.tag, outcome)
            yield answers
            if isinstance(outcome, Silent | Garbled) and not outcome.is_sent:
                await asyncio.sleep(UNSENT_PAUSE_S)


async def identified(setup: StarterSetup, put: Callable[[Question], Awaitable[Outcome]]) -> Identity:
    """Return what a device says about itself; CommandError when none answers, or another than configured."""
    answers = Answers()
    async for said in interview(setup.profile, answers, put):
        answers = said
    if not answers.is_there:
        raise CommandError(ResultCode.OFFLINE, "address", starter=setup.name, address=setup.address)
    standing = judged(met(Standing()), setup, answers, None)
    if standing.status is not IdentityStatus.MATCHING:
        raise not_matching(standing.status, standing.reason)
    return standing.identity
