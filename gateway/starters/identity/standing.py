"""Who answers at one starter's address: the states, the answers of one contact, the next question.

A contact begins with the first answer, and again after each silence and each opening of the port. A question
is put at most `TRIES` times, once a round; the device is judged once no question is open. Only FC43 names an
SSW-07 or SSW-08, and the manual does not print an SSW-08's answer (ssw07 5.4.7): a device that has their
registers is read without a name, but takes no commands. Any other that is not identified gives no good value.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from gateway.contract import CommandError, Event, EventCode, ResultCode, event_of, phrase
from gateway.families import Identity, Profile, Question, diagnosis
from gateway.line import Answered, Outcome, Refused
from gateway.modbus import ExceptionCode, ReadHoldingRegisters, ReadInputRegisters
from gateway.starters.identity.fingerprint import IdentityMismatch
from gateway.starters.setup import StarterSetup

TRIES = 3  # a reply may be lost, and one that is lost often says nothing of the device
NAME = "fc43"  # the tag of Read Device Identification
_ABSENT = {ExceptionCode.ILLEGAL_FUNCTION, ExceptionCode.ILLEGAL_DATA_ADDRESS}


class IdentityStatus(enum.Enum):
    """What is known of the device that answers; commands need `MATCHING`."""

    UNKNOWN = "unknown"  # it is silent, or has not said who it is
    ASKING = "asking"
    MATCHING = "matching"
    MISMATCHED = "mismatched"  # another family
    CHANGED = "changed"  # the family, but another device than before, or another model than configured
    OTHER_SLOT = "other slot"  # its accessory sits elsewhere than configured; it can be read


_CODES = {
    IdentityStatus.UNKNOWN: ResultCode.IDENTITY_UNKNOWN,
    IdentityStatus.ASKING: ResultCode.IDENTITY_UNKNOWN,
    IdentityStatus.MISMATCHED: ResultCode.IDENTITY_MISMATCH,
    IdentityStatus.CHANGED: ResultCode.IDENTITY_CHANGED,
    IdentityStatus.OTHER_SLOT: ResultCode.SLOT_MISMATCH,
}

_ANY = {*IdentityStatus}
# It went silent; it answers, or the port was opened.
_ALWAYS = {IdentityStatus.UNKNOWN, IdentityStatus.ASKING}
TRANSITIONS: Mapping[IdentityStatus, Set[IdentityStatus]] = {
    IdentityStatus.UNKNOWN: _ANY,  # a device that has not said who it is is asked again
    IdentityStatus.ASKING: _ANY,
    IdentityStatus.MATCHING: _ALWAYS,
    IdentityStatus.MISMATCHED: _ANY,
    IdentityStatus.CHANGED: {*_ALWAYS, IdentityStatus.MATCHING, IdentityStatus.OTHER_SLOT},  # it is accepted
    IdentityStatus.OTHER_SLOT: _ALWAYS,
}

Misses = tuple[int | None, ...]  # the exceptions that a question was refused with; None for no reply


@dataclass(frozen=True, slots=True)
class Answers:
    """The answers of one device in one contact, by the questions' tags."""

    said: Mapping[str, Any] = field(default_factory=dict)
    misses: Mapping[str, Misses] = field(default_factory=dict)

    @property
    def is_there(self) -> bool:
        """Return whether anything was answered or refused."""
        return bool(self.said) or any(code is not None for codes in self.misses.values() for code in codes)

    def after(self, tag: str, outcome: Outcome) -> Answers:
        """Return the answers with this one; a question that was not sent was not put."""
        if isinstance(outcome, Answered):
            return replace(self, said={**self.said, tag: outcome.value})
        if isinstance(outcome, Refused):
            return self.missed(tag, outcome.code)
        return self.missed(tag) if outcome.is_sent else self

    def missed(self, tag: str, code: int | None = None) -> Answers:
        """Return the answers with one more refusal of this question, or once more no reply to it."""
        return replace(self, misses={**self.misses, tag: (*self.misses.get(tag, ()), code)})

    def unnamed(self) -> Answers:
        """Return what the next contact begins with: how often FC43 was put, unless it was answered."""
        is_named = NAME in self.said or NAME not in self.misses
        return Answers() if is_named else Answers(misses={NAME: self.misses[NAME]})


@dataclass(frozen=True, slots=True)
class Standing:
    """One starter's identity at one moment; `reason` says why commands are held, empty when they are not."""

    status: IdentityStatus = IdentityStatus.UNKNOWN
    identity: Identity = field(default_factory=lambda: Identity(reason="not yet asked"))
    reason: str = "not yet asked"
    contradiction: str = ""  # of the configuration: values would be of another family or model
    is_readable: bool = False  # what is read now counts
    event: Event | None = None  # of what holds the commands
    mismatch: IdentityMismatch | None = None  # it waits to be accepted

    @property
    def is_family(self) -> bool:
        """Return whether the device has proved to be of the configured family."""
        return self.status in (IdentityStatus.MATCHING, IdentityStatus.CHANGED, IdentityStatus.OTHER_SLOT)

    def become(self, status: IdentityStatus, reason: str, **changes: Any) -> Standing:
        """Return the standing in another status; KeyError where it cannot follow."""
        if status not in TRANSITIONS[self.status]:
            raise KeyError(self.status, status)
        nothing = {"contradiction": "", "event": None, "mismatch": None}
        return replace(self, status=status, reason=reason, **{**nothing, **changes})


def met(standing: Standing) -> Standing:
    """Return the standing of a device that answers, and is asked who it is."""
    return standing.become(IdentityStatus.ASKING, "it is being identified", is_readable=False)


def silenced(standing: Standing) -> Standing:
    """Return the standing of a device that went silent: another may answer next."""
    why = "it has not been asked since it went silent"
    return standing.become(IdentityStatus.UNKNOWN, why, identity=Identity(reason=why), is_readable=False)


def judged(
    standing: Standing, setup: StarterSetup, answers: Answers, mismatch: IdentityMismatch | None
) -> Standing:
    """Return the standing of a device that has given these answers; `mismatch` is of the one known before.

    A device of another family stays that until an answer says otherwise.
    """
    profile, identity = setup.profile, identity_of(setup.profile, answers)
    why_not = diagnosis.why_not(profile, identity)
    become = partial(standing.become, identity=identity)
    if why_not is not None and (identity.family_seen is not None or identity.lacks):
        event = event_of(
            EventCode.IDENTITY_MISMATCH,
            expected=profile.family,
            seen=identity.family_seen,
            model=identity.model,
            reason=why_not,
        )
        return become(
            IdentityStatus.MISMATCHED, why_not, contradiction=why_not, is_readable=True, event=event
        )
    if why_not is not None:
        is_readable = _is_read_without_name(profile, answers)
        if standing.status is IdentityStatus.MISMATCHED and not is_readable:
            return standing  # no answer says otherwise
        event = event_of(EventCode.IDENTITY_UNKNOWN, reason=why_not)
        return become(IdentityStatus.UNKNOWN, why_not, is_readable=is_readable, event=event)
    if mismatch is not None:
        become = partial(become, contradiction=mismatch.contradiction, mismatch=mismatch)
        event = mismatch.event
        return become(IdentityStatus.CHANGED, event.text, is_readable=True, event=event)
    if trouble := diagnosis.slot_trouble(profile, setup.variant, identity):
        slot, seen = setup.variant.slot, identity.slot
        event = event_of(EventCode.SLOT_MISMATCH, configured=slot, seen=seen, reason=trouble)
        return become(IdentityStatus.OTHER_SLOT, trouble, is_readable=True, event=event)
    return become(IdentityStatus.MATCHING, "", is_readable=True)


def next_question(profile: Profile, answers: Answers, round_: int = TRIES) -> Question | None:
    """Return the first open question that this round (1 to `TRIES`) has not put yet; None ends the round."""
    if identity_of(profile, answers).family_seen not in (None, profile.family):
        return None  # another family: a stop is to speak its words at once
    for question in diagnosis.identify_requests(profile):
        misses = answers.misses.get(question.tag, ())
        is_needed = question.is_always_there or question.tag == NAME
        is_closed = question.tag in answers.said or (not is_needed and not _ABSENT.isdisjoint(misses))
        is_superfluous = question.is_for_doubt and NAME in answers.said
        puts = len(misses) + question.is_for_doubt  # not in the first round
        if puts < round_ and not is_closed and not is_superfluous:
            return question
    return None


def identity_of(profile: Profile, answers: Answers) -> Identity:
    """Return who has given these answers, and what it has refused that the family has."""
    identity = diagnosis.identify(profile, answers.said)
    if identity.lacks or identity.family_seen not in (None, profile.family):
        return identity  # another name says more
    refused = {
        part
        for question in diagnosis.identify_requests(profile)
        if question.tag not in (NAME, *answers.said)
        and (part := _refused_part(question, answers.misses.get(question.tag, ())))
    }
    parts = ", ".join(sorted(refused))
    return replace(identity, lacks=parts and phrase(EventCode.IDENTITY_UNKNOWN, "refuses", parts=parts))


def not_matching(status: IdentityStatus, why: str) -> CommandError:
    """Return the refusal of a command to a device that has not proved to be the configured one."""
    return CommandError(_CODES[status], why=why)


def _is_read_without_name(profile: Profile, answers: Answers) -> bool:
    """Return whether only FC43 could name this device, and it spoke for the family in all else it was asked.

    A question without any reply leaves it open: a slower device of another family may refuse it too late.
    """
    others = [each for each in diagnosis.identify_requests(profile) if each.tag != NAME]
    has_registers = all(each.tag in answers.said for each in others if each.is_always_there)
    is_clear = all(each.tag in answers.said or any(answers.misses.get(each.tag, ())) for each in others)
    is_nameless = NAME not in answers.said and not diagnosis.distinctive_rows(profile)
    return bool(others) and has_registers and is_clear and is_nameless


def _refused_part(question: Question, codes: Misses) -> str:
    """Return what a device refuses that every one of the family has; empty for nothing."""
    request = question.request
    if ExceptionCode.ILLEGAL_FUNCTION in codes:
        return f"Modbus function {request.function:02d}"
    is_refused = question.is_always_there and ExceptionCode.ILLEGAL_DATA_ADDRESS in codes
    if is_refused and isinstance(request, ReadHoldingRegisters | ReadInputRegisters):
        return f"register {request.address}"
    return ""
