"""Whether the device that answers now is the one that was identified, by what another would answer otherwise.

Not every swap shows by a silence: an address that is given anew, a serial server that points elsewhere. Each
family names the few requests that distinguish it from the others (`Question.is_distinctive`: by their value;
`is_always_there`: by being answered). They are asked again before each write, after anything that is unlike
the device, and now and then where the polls would not show it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from gateway.families import Profile, Question, diagnosis
from gateway.line import EXPIRES_S, Answered, Garbled, Outcome, Refused, whole_frame
from gateway.modbus.codes import EXCEPTION_BIT

Put = Callable[[Question], Awaitable[Outcome]]

TRIES = 2  # a lost reply says nothing
TRIES_OF_COMMANDS = 3  # more are no use while nothing waits for it: three misses in a row are a silence
REFUSALS = 2  # each may answer an earlier request; another device answers one of so many,
# and of one more than replies to the same question are owed


class Recognition:
    """Of one starter: what the device said when it was identified."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        questions = diagnosis.identify_requests(profile)
        self._questions = tuple(q for q in questions if q.is_distinctive or q.is_always_there)
        self.is_hidden = any(q.is_distinctive for q in questions)  # the polls might not show another device
        self._said: dict[Question, Outcome] = {}
        self._unanswered_s: dict[Question, list[float]] = {}  # when; these replies may still come

    def forget(self) -> None:
        """Begin anew: the device is open."""
        self._said.clear()

    @property
    def is_complete(self) -> bool:
        """Return whether another device would show at once: each question had a clear answer."""
        return all(question in self._said for question in self._questions)

    def note(self, outcomes: Mapping[Question, Outcome]) -> None:
        """Record what the device that is there now has answered."""
        self._said = {q: outcomes[q] for q in self._questions if _is_clear(outcomes.get(q))}

    def note_unanswered(self, question: Question, now_s: float) -> None:
        """Record that there was no answer to a question, of whatever device is there."""
        owed_s = [at_s for at_s in self._unanswered_s.get(question, ()) if at_s > now_s - EXPIRES_S]
        self._unanswered_s[question] = [*owed_s, now_s]

    def owed(self, question: Question) -> int:
        """Return how many replies to a question may still come."""
        since_s = asyncio.get_running_loop().time() - EXPIRES_S
        return sum(at_s > since_s for at_s in self._unanswered_s.get(question, ()))

    async def is_completed_otherwise(self, put: Put) -> bool:
        """Ask what was not asked yet of a device that is proved; return whether that denies it."""
        for question in self._questions:
            outcome = None if question in self._said else await put(question)
            if not isinstance(outcome, Answered) and not isinstance(outcome, Refused):
                continue
            if isinstance(outcome, Answered):
                family = diagnosis.identify(self._profile, {question.tag: outcome.value}).family_seen
                if family not in (None, self._profile.family):
                    return True
            if _is_clear(outcome):
                self._said[question] = outcome
        return False

    async def is_same(self, put: Put, *, is_brief: bool = False, tries: int = TRIES) -> bool | None:
        """Return whether it answers as it did; None when it could not be asked, so often in a row.

        `is_brief` asks only what the polls do not show. What it never answered clearly is not asked.
        """
        for question in self._questions:
            if question in self._said and (question.is_distinctive or not is_brief):
                is_same = await self._is_as_before(question, put, tries)
                if not is_same:
                    return is_same
        return True

    async def _is_as_before(self, question: Question, put: Put, tries: int) -> bool | None:
        before = self._said[question]
        refusals = misses = 0
        while misses < tries:
            now = await put(question)
            if isinstance(now, Answered):
                return isinstance(before, Answered) and (
                    not question.is_distinctive or before.value == now.value
                )
            code, is_sure = _refusal_code(now, question.request.function), isinstance(now, Refused)
            if code is None:
                misses += 1
            elif not isinstance(before, Refused):
                return False
            elif code != before.code:
                return False if is_sure else None  # it answers an earlier request, or is another device's
            else:
                refusals += 1
                if refusals > self.owed(question) and (is_sure or refusals >= REFUSALS):
                    return True
        return None


def is_refusal(outcome: Garbled, function: int | None = None) -> bool:
    """Return whether a whole exception came, of this function, that may answer an earlier request."""
    frame = whole_frame(outcome.received)
    if frame is None or not frame.pdu[0] & EXCEPTION_BIT:
        return False
    return function is None or frame.pdu[0] == function | EXCEPTION_BIT


def _refusal_code(outcome: Outcome, function: int) -> int | None:
    """Return the code of a refusal that lasts, or that may answer an earlier request; None of all else."""
    if isinstance(outcome, Refused):
        return outcome.code if outcome.is_lasting else None
    if isinstance(outcome, Garbled) and is_refusal(outcome, function):
        return outcome.received[2]  # unit, function, code [APP 7]
    return None


def _is_clear(outcome: Outcome | None) -> bool:
    return isinstance(outcome, Answered) or (isinstance(outcome, Refused) and outcome.is_lasting)
