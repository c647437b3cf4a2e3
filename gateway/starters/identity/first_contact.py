"""The first contact with a starter that answers: its watchdog, then who it is, until that is proved.

A watchdog counts from the first telegram that reaches the starter (ssw900 C8.2.5; ssw06-es and ssw07 2.4), so
it must be known before the line has come round once.
"""

from __future__ import annotations

import asyncio
import enum
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from gateway.errors import CommandError, PortLostError
from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identify import identify, identify_requests, why_not
from gateway.families.diagnosis.readiness import time_codes
from gateway.families.profile.schema import Profile
from gateway.families.reading.bulk import bulk_reads
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Answered, Outcome, Refused
from gateway.line.scheduler.requests import Priority
from gateway.modbus.codes import ExceptionCode, Function
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import read_in_bulk
from gateway.starters.setup import Asked, StarterSetup, ask
from gateway.system.backoff import Backoff
from gateway.system.supervised import SupervisedTask

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
        self._watchdog_reads = bulk_reads(setup.profile, time_codes(setup.profile))
        self._task = SupervisedTask(f"first contact {setup.name}")
        self.cancel, self.close = self._task.cancel, self._task.close
        self.is_settled = False  # no question is open any more, or it has been asked often enough
        self.is_answered = False  # the same, with the patience that values have: see `Withheld`

    def begin(self, *, is_known: bool) -> None:
        """Ask from the beginning; a watchdog that is known waits until all starters have been asked once."""
        lane = Priority.READ_BACK if is_known else Priority.COMMAND
        self._task.begin(partial(self._meet, lane))

    async def _meet(self, lane: Priority) -> None:
        with suppress(CommandError, PortLostError):  # it is read again with the other settings
            asked = partial(self._ask, lane=lane)
            found = await read_in_bulk(asked, self._setup.profile, self._watchdog_reads, tries=1)
            self._on_rows(found.rows)
        await self._ask_until_proved()

    async def _ask_until_proved(self) -> None:
        """Ask ever less often; never twice at once, since two misses in a row make a unit count as silent."""
        pauses, rounds = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S), 0
        lacking: frozenset[int] = frozenset()
        while True:
            questions = identify_requests(self._setup.profile)
            outcomes = {q.tag: await self._ask(q.request, lane=Priority.READ_BACK) for q in questions}
            identity = identify(self._setup.profile, {tag: _answer(out) for tag, out in outcomes.items()})
            lacked_before, lacking = lacking, _lacking(self._setup.profile, outcomes)
            identity = replace(identity, lacks=identity.lacks or _lacks(lacking & lacked_before))
            standing = standing_of(self._setup, identity)
            rounds += 1
            is_complete = all(isinstance(outcome, (Answered, Refused)) for outcome in outcomes.values())
            self.is_settled = is_complete or rounds >= MOST_ROUNDS
            enough = REFUSED_ROUNDS if is_complete else GIVEN_UP_ROUNDS
            self.is_answered = (is_complete and standing is not IdentityStatus.UNKNOWN) or rounds >= enough
            self._on_identity(identity)
            if standing is IdentityStatus.MATCHING and self.is_settled:
                return
            await asyncio.sleep(pauses.next_s())

    def _ask(self, request: Request, *, lane: Priority) -> Asked:
        return ask(self._line, self._setup, request, lane=lane)


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
