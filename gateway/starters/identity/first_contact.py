"""The first contact with a starter: its watchdog, then who it is, until that is proved; then if it still is.

A watchdog counts from the first telegram that reaches the starter (ssw900 C8.2.5; ssw06-es and ssw07 2.4), so
it must be known before the line has come round once. What is known stands while it is asked again, until a
device proves to be another or does not answer such questions any more.
"""

from __future__ import annotations

import asyncio
import enum
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

from gateway.contract import CommandError, EventCode, ResultCode, phrase
from gateway.errors import PortLostError
from gateway.families import Identity, Question, diagnosis, reading
from gateway.line import Answered, Garbled, LineClient, Outcome, Priority, Refused, Silent
from gateway.modbus import adu
from gateway.modbus.codes import EXCEPTION_BIT, ExceptionCode, Function
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters, ReadInputRegisters
from gateway.starters.bulk_read import read_in_bulk
from gateway.starters.identity.recognition import TRIES_OF_COMMANDS, Recognition, is_refusal
from gateway.starters.setup import Asked, StarterSetup, ask
from gateway.system.rate_limits import Backoff, backoff_s
from gateway.system.supervised import SupervisedTask

FIRST_PAUSE_S = 2.0
LONGEST_PAUSE_S = 60.0
WITHHELD_PAUSE_S = 8.0  # at most, while values are withheld until it is known who answers
DOUBT_WITHIN_S = 1.0  # a refusal that may be a late one holds up no round for longer
_ABSENT = (ExceptionCode.ILLEGAL_FUNCTION, ExceptionCode.ILLEGAL_DATA_ADDRESS)
MOST_ROUNDS = 5  # of a starter that matches but leaves a question open
LOOK_AGAIN_S = 15.0  # for each unit of the line: where the polls might not show another device
DOUBTS_APART_S = 10.0
UNANSWERED_MOST = 3  # times without an answer; then FC43 is put less often
FC43_PAUSE_S, FC43_LONGEST_PAUSE_S = 60.0, 3600.0
REFUSED_ROUNDS = 2  # after which a refusal is no chance: about 2 s
GIVEN_UP_ROUNDS = 3  # after which a device counts as one that does not answer such questions: about 7 s


class IdentityStatus(enum.Enum):
    """What is known of who answers; commands need `MATCHING`, else the value is their result's code."""

    UNKNOWN = ResultCode.IDENTITY_UNKNOWN
    MATCHING = "matching"
    MISMATCHED = ResultCode.IDENTITY_MISMATCH
    OTHER_SLOT = ResultCode.SLOT_MISMATCH  # its accessory sits elsewhere than configured; it can be read
    CHANGED = (
        ResultCode.IDENTITY_CHANGED
    )  # the family matches, but it is another than before; see `IdentityRegistry`


def not_matching(standing: IdentityStatus, why: str) -> CommandError:
    """Return the refusal of a command to a device that has not proved to be the configured one."""
    return CommandError(ResultCode(standing.value), why=why)


def standing_of(setup: StarterSetup, identity: Identity) -> IdentityStatus:
    """Return whether an identity is the configured family."""
    if diagnosis.why_not(setup.profile, identity) is None:
        return IdentityStatus.MATCHING
    proves_other = identity.family_seen is not None or identity.lacks
    return IdentityStatus.MISMATCHED if proves_other else IdentityStatus.UNKNOWN


class FirstContact:
    """Meets one starter; `on_rows` gets its watchdog's settings, `on_identity` every identity found."""

    def __init__(
        self,
        setup: StarterSetup,
        line: LineClient,
        *,
        on_rows: Callable[[Mapping[str, tuple[int, ...]]], None],
        on_identity: Callable[[Identity], None],
    ) -> None:
        self._setup = setup
        self._line = line
        self._on_rows = on_rows
        self._on_identity = on_identity
        self._watchdog_reads = reading.bulk_reads(setup.profile, diagnosis.time_codes(setup.profile))
        self._refusals: Counter[str] = Counter()  # by what is refused: rounds since it was answered
        self._task = SupervisedTask(f"first contact {setup.name}")
        self.close = self._task.close
        self._recognition = Recognition(setup.profile)
        self._fc43 = Fc43Backoff()
        self._waker: asyncio.Future[None] | None = None  # while there is no question to put
        self._is_open = True  # the one that answers now has not proved itself
        self._is_doubted = False
        self._doubted_s = -inf  # when that was looked at last
        self._waiting: list[asyncio.Future[Identity]] = []  # for a round that begins from now on
        self.is_settled = False  # no question is open any more, or it has been asked often enough
        self.is_answered = False  # the same, with the patience that values have: see `Withheld`

    def begin(self, *, is_known: bool) -> None:
        """Ask from the beginning; a watchdog that is known waits until all starters have been asked once."""
        lane = Priority.IDENTITY if is_known else Priority.WATCHDOG
        self._task.begin(partial(self._meet, lane))

    def cancel(self) -> None:
        """Ask nothing any more."""
        self._task.cancel()
        for each in self._waiting:
            if not each.done():
                each.set_exception(CommandError(ResultCode.OFFLINE, "starter"))
        self._waiting.clear()

    def note_silence(self) -> None:
        """Record that the starter went silent, perhaps for its latest question; ask nothing any more."""
        self._fc43.note_silence(asyncio.get_running_loop().time())
        self.cancel()

    def doubt(self) -> None:
        """Look again soon whether it is still the same device: it does not behave like it."""
        if asyncio.get_running_loop().time() >= self._doubted_s + DOUBTS_APART_S:
            self._is_doubted = True
            self._wake()

    async def is_same(self, lane: Priority) -> bool | None:
        """Return whether the device that was identified is the one that answers; None: none does."""
        if self._is_open:
            return False  # what it said last is no measure of the one that was identified
        put = partial(self._put, lane=min(lane, Priority.READ_BACK))
        if not self._recognition.is_complete and await self._recognition.is_completed_otherwise(put):
            return False
        if not self._recognition.is_complete:
            return False  # what it said is not enough to compare it by
        return await self._recognition.is_same(partial(put, is_patient=True), tries=TRIES_OF_COMMANDS)

    async def asked_anew(self) -> Identity:
        """Return who answers, by a round of questions that begins from now on."""
        answer: asyncio.Future[Identity] = asyncio.get_running_loop().create_future()
        self._waiting.append(answer)
        self._wake()
        return await answer

    async def _meet(self, lane: Priority) -> None:
        self._recognition.forget()
        with suppress(CommandError, PortLostError):  # it is read again with the other settings
            asked = partial(self._ask, lane=lane)
            found = await read_in_bulk(asked, self._setup.profile, self._watchdog_reads, tries=1)
            self._on_rows(found.rows)
        is_again = False
        while True:
            self._is_open = True
            await self._ask_until_proved(is_again=is_again)
            is_again = True

    async def _ask_until_proved(self, *, is_again: bool) -> None:
        """Ask ever less often until it is proved, and return when that is open again.

        Never twice at once, since two misses in a row make a unit count as silent.
        """
        pauses, rounds = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S), 0
        has_registers = False  # it has read one as this family does
        known: dict[Question, Outcome] = {}
        before = IdentityStatus.UNKNOWN if is_again else None
        while True:
            waiting = tuple(self._waiting)
            is_thorough = is_again or rounds > 0
            outcomes = await self._put_round(known, is_thorough=is_thorough)
            identity = self._identity_by(outcomes)
            has_registers |= any(_has_registers(*each) for each in outcomes.items())
            standing = standing_of(self._setup, identity)
            is_changed, before = before not in (None, standing), standing
            self._is_open = standing is not IdentityStatus.MATCHING
            known = {q: out for q, out in outcomes.items() if q.is_asked_once and _is_final(out)}
            if is_changed:
                known = {}  # it was another device that said so
            if standing is IdentityStatus.MISMATCHED:
                known, self._fc43 = {}, Fc43Backoff()  # what it said or not says nothing of the right one
            rounds += 1
            is_complete = all(map(_is_clear, outcomes.values()))
            self.is_settled = is_complete or rounds >= MOST_ROUNDS
            enough = REFUSED_ROUNDS if is_complete else GIVEN_UP_ROUNDS
            is_known = standing is not IdentityStatus.UNKNOWN or has_registers
            self.is_answered = is_known and (
                (is_complete and standing is not IdentityStatus.UNKNOWN) or rounds >= enough
            )
            if standing is not IdentityStatus.UNKNOWN or not is_again or rounds >= GIVEN_UP_ROUNDS:
                self._on_identity(identity)
            if is_changed:
                self._recognition.forget()  # some of these answers may be another device's
            else:
                self._recognition.note(outcomes)
            for each in waiting:
                self._waiting.remove(each)
                if not each.done():
                    each.set_result(identity)
            is_proved = standing is IdentityStatus.MATCHING and self.is_settled
            pause_s = inf if is_proved else pauses.next_s()
            if not is_proved and not (self.is_answered and self._recognition.is_complete):
                pause_s = min(pause_s, WITHHELD_PAUSE_S)
            if await self._is_another(pause_s, is_proved=is_proved):
                return

    async def _put_round(
        self, known: Mapping[Question, Outcome], *, is_thorough: bool
    ) -> dict[Question, Outcome]:
        """Put each question that is open, one after the other.

        After a refusal in doubt no other of its function is put: that one would leave both in doubt.
        """
        outcomes: dict[Question, Outcome] = {}
        doubtful: dict[int, Outcome] = {}  # by function
        for question in diagnosis.identify_requests(self._setup.profile):
            function = question.request.function
            if question.is_for_doubt and not is_thorough:
                continue
            outcome = known.get(question) or doubtful.get(function) or await self._put(question)
            if function == Function.ENCAPSULATED and isinstance(outcome, Answered):
                outcome = await self._said_again(question, outcome)
            outcomes[question] = outcome
            if isinstance(outcome, Garbled) and is_refusal(outcome, function):
                doubtful[function] = outcome
        return outcomes

    async def _said_again(self, question: Question, said: Answered) -> Outcome:
        """Return an answer that came once more than such are owed: those may be another device's."""
        for _ in range(self._recognition.owed(question)):
            again = await self._put(question)
            if not isinstance(again, Answered):
                return again
            if again.value != said.value:
                return Silent("it says first this, then that")
        return said

    def _identity_by(self, outcomes: Mapping[Question, Outcome]) -> Identity:
        """Return who has given these answers, and what it has refused too often."""
        identity = diagnosis.identify(
            self._setup.profile, {q.tag: _answer(out) for q, out in outcomes.items()}
        )
        self._count_refusals(outcomes)
        if identity.family_seen in (None, self._setup.profile.family):  # another name says more
            identity = replace(identity, lacks=identity.lacks or self._lacking())
        return identity

    async def _is_another(self, pause_s: float, *, is_proved: bool) -> bool:
        """Wait so long, and look now and then whether it is still the same device; return once it is not."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + pause_s
        put = partial(self._put, lane=Priority.PATROL)
        if is_proved and await self._recognition.is_completed_otherwise(put):
            return True
        while (left_s := until_s - loop.time()) > 0 and not self._waiting:
            await self._rest(min(left_s, self._look_again_s(is_proved=is_proved)))
            if loop.time() >= until_s or self._waiting:
                break
            is_brief, self._is_doubted = is_proved and not self._is_doubted, False
            self._doubted_s = loop.time()
            if is_proved and await self._recognition.is_completed_otherwise(put):
                return True
            if await self._recognition.is_same(put, is_brief=is_brief) is False:
                return True
        return is_proved

    def _look_again_s(self, *, is_proved: bool) -> float:
        """Return after what time it is looked at without any doubt; seldom, where many share the line."""
        if not is_proved:
            return WITHHELD_PAUSE_S
        return LOOK_AGAIN_S * max(self._line.unit_count, 1) if self._recognition.is_hidden else inf

    async def _rest(self, seconds: float) -> None:
        """Wait so long, or until there is a reason to ask."""
        loop = asyncio.get_running_loop()
        if self._is_doubted or self._waiting:
            return
        self._waker = loop.create_future()
        timer = None if seconds == inf else loop.call_later(seconds, self._wake)
        try:
            await self._waker
        finally:
            self._waker = None
            if timer is not None:
                timer.cancel()

    def _wake(self) -> None:
        if self._waker is not None and not self._waker.done():
            self._waker.set_result(None)

    def _count_refusals(self, outcomes: Mapping[Question, Outcome]) -> None:
        """Count what the manual gives for this family and this device says that it does not have.

        Read Device Identification is none: what an SSW-08 does with it is not stated (ssw07 5.4.7). A refusal
        that may answer an earlier request says the same of the function (a slow device's are late).
        """
        had, refused = set(), set()
        for question, outcome in outcomes.items():
            function = question.request.function
            if function == Function.ENCAPSULATED:
                continue
            as_function, as_registers = f"Modbus function {function:02d}", _registers(question.request)
            if isinstance(outcome, Answered):
                had |= {as_function, as_registers}
            elif self._is_without(function, outcome):
                refused.add(as_function)
            elif question.is_always_there and isinstance(outcome, Refused):
                refused |= {as_registers} if outcome.code == ExceptionCode.ILLEGAL_DATA_ADDRESS else set()
        for what in had:
            del self._refusals[what]
        self._refusals.update(refused - had)

    def _lacking(self) -> str:
        """Return what it has refused too often for a chance; empty for nothing."""
        lacking = (part for part, count in self._refusals.items() if count >= REFUSED_ROUNDS)
        parts = ", ".join(sorted(lacking))
        return phrase(EventCode.IDENTITY_UNKNOWN, "refuses", parts=parts) if parts else ""

    def _is_without(self, function: int, outcome: Outcome) -> bool:
        if isinstance(outcome, Refused):
            return outcome.code == ExceptionCode.ILLEGAL_FUNCTION
        if not isinstance(outcome, Garbled):
            return False
        said = bytes((function | EXCEPTION_BIT, ExceptionCode.ILLEGAL_FUNCTION))
        return outcome.received == adu.encode(self._setup.address, said)

    def _ask(self, request: Request, *, lane: Priority) -> Asked:
        return ask(self._line, self._setup, request, lane=lane)

    async def _put(
        self, question: Question, *, lane: Priority | None = None, is_patient: bool = False
    ) -> Outcome:
        """Put a question in its own form: an SST answers for the coils of VB01, too.

        Without a `lane` it is the gateway's own, unless a command waits for the answer.
        """
        if lane is None:
            lane = Priority.READ_BACK if self._waiting else Priority.IDENTITY
        now_s = asyncio.get_running_loop().time()
        is_fc43 = question.request.function == Function.ENCAPSULATED
        if is_fc43 and not self._fc43.may_ask(now_s):
            return NOT_ASKED
        outcome = await ask(
            self._line,
            self._setup,
            question.request,
            lane=lane,
            until_s=now_s + DOUBT_WITHIN_S if question.is_for_doubt and not is_patient else inf,
        )
        now_s = asyncio.get_running_loop().time()
        if is_fc43:
            self._fc43.note(outcome, now_s)
        if isinstance(outcome, Silent) and outcome.is_sent:
            self._recognition.note_unanswered(question, now_s)
        return outcome


NOT_ASKED = Silent("it is not asked: it was not answered several times", is_sent=False)


class Fc43Backoff:
    """Whether a device may be asked FC43: one that does not know it may be silent for a while after it.

    What it does not answer several times in a row is asked ever less often; sooner where the starter even
    goes offline after it, since all its questions are put anew then.
    """

    def __init__(self) -> None:
        self._is_open = False  # it was asked last, and had no answer
        self._unanswered = 0  # in a row
        self._not_before_s = -inf

    def may_ask(self, now_s: float) -> bool:
        """Return whether it may be asked now."""
        return now_s >= self._not_before_s

    def note(self, outcome: Outcome, now_s: float) -> None:
        """Record what came of it."""
        self._is_open = isinstance(outcome, Silent) and outcome.is_sent
        if self._is_open:
            self._count(now_s)
        elif _is_clear(outcome):
            self._unanswered = 0

    def note_silence(self, now_s: float) -> None:
        """Record that the device went silent."""
        if self._is_open:
            self._count(now_s)
        self._is_open = False

    def _count(self, now_s: float) -> None:
        self._unanswered += 1
        if self._unanswered >= UNANSWERED_MOST:
            times = self._unanswered - UNANSWERED_MOST
            self._not_before_s = now_s + backoff_s(FC43_PAUSE_S, FC43_LONGEST_PAUSE_S, times)


def _has_registers(question: Question, outcome: Outcome) -> bool:
    """Return whether this shows that the device has registers as the family does."""
    is_there = isinstance(outcome, Answered) or (isinstance(outcome, Refused) and not outcome.is_lasting)
    return question.is_always_there and is_there


def _registers(request: Request) -> str:
    assert isinstance(request, ReadHoldingRegisters | ReadInputRegisters)
    return f"register {request.address}"


def _is_clear(outcome: Outcome) -> bool:
    return isinstance(outcome, Answered | Refused) or outcome is NOT_ASKED


def _is_final(outcome: Outcome) -> bool:
    """Return whether this was an answer, or says that there is none; a failure may pass."""
    is_absent = isinstance(outcome, Refused) and outcome.code in _ABSENT
    return is_absent or isinstance(outcome, Answered)


def _answer(outcome: Outcome) -> Any:
    return outcome.value if isinstance(outcome, Answered) else None
