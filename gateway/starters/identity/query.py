"""Asks a starter who it is, until it has proved to be what the configuration says."""

from __future__ import annotations

import asyncio
import enum
import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

from gateway.families.profile.identify import Identity, Question, identify, identify_requests, why_not
from gateway.families.profile.schema import Profile
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Answered, Outcome, Refused
from gateway.line.scheduler.requests import Priority
from gateway.modbus.codes import ExceptionCode, Function
from gateway.starters.setup import StarterSetup

logger = logging.getLogger(__name__)

FIRST_PAUSE_S = 2.0
LONGEST_PAUSE_S = 60.0
MOST_ROUNDS = 5  # of a starter that matches but leaves a question open
REFUSED_ROUNDS = 2  # after which a refusal is no chance: about 2 s
GIVEN_UP_ROUNDS = 3  # after which a device counts as one that does not answer such questions: about 7 s


class IdentityStatus(enum.Enum):
    """What is known of who answers; commands need `MATCHING`."""

    UNKNOWN = "unknown"
    MATCHING = "matching"
    MISMATCHED = "mismatch"
    CHANGED = "changed"  # the family matches, but it is another starter than before; see `Identities`


def standing_of(setup: StarterSetup, identity: Identity) -> IdentityStatus:
    """Return whether an identity is the configured family."""
    if why_not(setup.profile, identity) is None:
        return IdentityStatus.MATCHING
    proves_other = identity.family_seen is not None or identity.lacks
    return IdentityStatus.MISMATCHED if proves_other else IdentityStatus.UNKNOWN


class IdentityQuery:
    """Identifies one starter; `tell` hears every identity found, on the app's loop."""

    def __init__(self, setup: StarterSetup, line: LineClient, tell: Callable[[Identity], None]) -> None:
        self._setup = setup
        self._line = line
        self._tell = tell
        self._task: asyncio.Task[None] | None = None
        self.is_settled = False  # no question is open any more, or it has been asked often enough
        self.is_answered = False  # the same, with the patience that values have: see `Withheld`

    def begin(self) -> None:
        """Ask from the beginning, in a task of its own."""
        self.cancel()
        self._task = asyncio.get_running_loop().create_task(self._run(), name=f"identify {self._setup.name}")

    def cancel(self) -> None:
        """Ask no more."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def close(self) -> None:
        """Ask no more, and wait until nothing of it is left."""
        task = self._task
        self.cancel()
        if task is not None:
            await asyncio.wait((task,))

    async def _run(self) -> None:
        try:
            await self._ask_until_proved()
        except Exception:  # the guard at the task's top
            logger.exception("starter=%s identification ended by a bug", self._setup.name)

    async def _ask_until_proved(self) -> None:
        """Ask ever less often; never twice at once, since two misses in a row make a unit count as silent."""
        pause_s, rounds = FIRST_PAUSE_S, 0
        lacking: frozenset[int] = frozenset()
        while True:
            outcomes = {q.tag: await self._transact(q) for q in identify_requests(self._setup.profile)}
            identity = identify(self._setup.profile, {tag: _answer(out) for tag, out in outcomes.items()})
            lacked_before, lacking = lacking, _lacking(self._setup.profile, outcomes)
            identity = replace(identity, lacks=identity.lacks or _lacks(lacking & lacked_before))
            standing = standing_of(self._setup, identity)
            rounds += 1
            is_complete = all(isinstance(outcome, (Answered, Refused)) for outcome in outcomes.values())
            self.is_settled = is_complete or rounds >= MOST_ROUNDS
            enough = REFUSED_ROUNDS if is_complete else GIVEN_UP_ROUNDS
            self.is_answered = (is_complete and standing is not IdentityStatus.UNKNOWN) or rounds >= enough
            self._tell(identity)
            if standing is IdentityStatus.MATCHING and self.is_settled:
                return
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    async def _transact(self, question: Question) -> Outcome:
        return await self._line.transact(
            self._setup.address,
            question.request,
            response_time_s=self._setup.response_time_of(question.request),
            lane=Priority.READ_BACK,
        )


def _lacking(profile: Profile, outcomes: Mapping[str, Outcome]) -> frozenset[int]:
    """Return the functions that the manual gives for this family and that this device says it does not have.

    Read Device Identification is none of them: what an SSW-08 does with it is not stated (ssw07 5.4.7).
    """
    asked = {question.tag: question.request.function for question in identify_requests(profile)}
    return frozenset(
        asked[tag]
        for tag, outcome in outcomes.items()
        if isinstance(outcome, Refused)
        and outcome.code == ExceptionCode.ILLEGAL_FUNCTION
        and asked[tag] != Function.ENCAPSULATED
    )


def _lacks(functions: Collection[int]) -> str:
    names = ", ".join(f"{function:02d}" for function in sorted(functions))
    return f"it refuses Modbus function {names}" if names else ""


def _answer(outcome: Outcome) -> Any:
    return outcome.value if isinstance(outcome, Answered) else None
