"""Who a device is by its answers, which question comes next, and the table of states."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families import Variant, load_profile
from gateway.line import Answered, Outcome, Refused, Silent
from gateway.modbus.device_id import DeviceIdentification
from gateway.modbus.timing import Framing, LineTiming
from gateway.starters.identity.standing import (
    TRANSITIONS,
    TRIES,
    Answers,
    IdentityStatus,
    Standing,
    judged,
    met,
    next_question,
    not_matching,
    silenced,
)
from gateway.starters.setup import StarterSetup

UNKNOWN, MATCHING, MISMATCHED, OTHER_SLOT = (
    IdentityStatus.UNKNOWN,
    IdentityStatus.MATCHING,
    IdentityStatus.MISMATCHED,
    IdentityStatus.OTHER_SLOT,
)


REST = "firmware 120; model 1,0,0,0,77,0"
SERIAL = "6,516,1,0,0,0,0,1,2,0,0"


def outcome(said: str) -> Outcome:
    """Return what a word stands for: `-` no reply, `!2` exception 2, `2,0` registers, else a name."""
    if said == "-":
        return Silent()
    if said.startswith("!"):
        return Refused(int(said[1:]), at_s=0.0)
    value: Any = DeviceIdentification({0: "WEG", 1: said, 2: "V1.20"})
    if said[0].isdigit():
        value = tuple(int(word) for word in said.split(","))
    return Answered(value, at_s=0.0, response_time_s=0.01)


def asked(family: str, said: str) -> tuple[str, Standing]:
    """Return which questions are put to a device that says this, at last repeatedly, and the judgement."""
    habits = {part.split()[0]: part.split()[1:] for part in said.split(";")}
    profile, answers = load_profile(family), Answers()
    tags: list[str] = []
    for round_ in range(1, TRIES + 1):
        while (question := next_question(profile, answers, round_)) is not None:
            habit, tries = habits[question.tag], tags.count(question.tag)
            answers = answers.after(question.tag, outcome(habit[min(tries, len(habit) - 1)]))
            tags.append(question.tag)
    variant, timing = Variant(slot=1 if family == "ssw900" else None), LineTiming(19200, Framing.parse("8E1"))
    setup = StarterSetup("pump", "pumps", 1, profile, variant, timing)
    return " ".join(tags), judged(met(Standing()), setup, answers, None)


@pytest.mark.parametrize(
    ("family", "said", "tags", "status", "is_readable"),
    [
        # A device that says its name is not asked for it again, nor for its model register.
        ("ssw07", "register 0; fc43 SSW-07", "register fc43", MATCHING, True),
        ("ssw07", "register - 0; fc43 SSW-07", "register fc43 register", MATCHING, True),
        # The answer of an SSW-08 to FC43 is not printed: it is read without a name.
        ("ssw07", "register 0; model !2; fc43 !1", "register fc43 model fc43 fc43", UNKNOWN, True),
        ("ssw07", "register 0; model 7; fc43 -", "register fc43 model fc43 fc43", UNKNOWN, True),
        ("ssw07", "register 0; model 7; fc43 - !6 SSW-08", "register fc43 model fc43 fc43", MATCHING, True),
        # An SSW-06 shows by its model register, an SST by the function that it does not have.
        ("ssw07", "register 0; model 15; fc43 -", "register fc43 model", MISMATCHED, True),
        ("ssw07", "register 0; model - !1; fc43 !1", "register fc43 model fc43 model fc43", MISMATCHED, True),
        ("ssw07", "register 0; model -; fc43 !1", "register fc43 model fc43 model fc43", UNKNOWN, False),
        ("ssw06", "register - !1 -; fc43 -", "register fc43 register fc43 register fc43", MISMATCHED, True),
        # Another name is enough.
        ("ssw06", "register -; fc43 SSW-07", "register fc43", MISMATCHED, True),
        ("ssw06", "register 15; fc43 CFW-11", "register fc43", MISMATCHED, True),
        # VB00 alone proves an SSW-06, or denies it.
        ("ssw06", "register 15; fc43 -", "register fc43 fc43 fc43", MATCHING, True),
        ("ssw06", "register 7; fc43 -", "register fc43 fc43 fc43", MISMATCHED, True),
        ("ssw06", "register -; fc43 -", "register fc43 register fc43 register fc43", UNKNOWN, False),
        # The slots prove an SSW900, whatever it calls itself, and say where its accessory sits.
        ("ssw900", f"slots 2,0; {REST}; fc43 CFW-11", "slots firmware model fc43", MATCHING, True),
        ("ssw900", f"slots 0,2; {REST}; fc43 SSW900", "slots firmware model fc43", OTHER_SLOT, True),
        ("ssw900", f"slots 0,0; {REST}; fc43 -", "slots firmware model fc43 fc43 fc43", UNKNOWN, False),
        # An SST has no FC43, and with old firmware no name.
        ("sst", f"model 330,{SERIAL}; name !2", "model name", MATCHING, True),
        ("sst", f"model 331,{SERIAL}; name -", "model name name name", UNKNOWN, False),
    ],
)
def test_who_a_device_is_by_its_answers(
    family: str, said: str, tags: str, status: IdentityStatus, *, is_readable: bool
) -> None:
    put, standing = asked(family, said)

    assert put == tags
    assert (standing.status, standing.is_readable) == (status, is_readable)
    assert (standing.reason == "") == (status is MATCHING)
    assert (standing.contradiction != "") == (status is MISMATCHED)


@pytest.mark.parametrize(("before", "after"), [*product(IdentityStatus, repeat=2)])
def test_a_pair_that_is_not_in_the_table_is_a_bug(before: IdentityStatus, after: IdentityStatus) -> None:
    if after in TRANSITIONS[before]:
        assert Standing(before).become(after, "").status is after
    else:
        with pytest.raises(KeyError):
            Standing(before).become(after, "")


@pytest.mark.parametrize("status", IdentityStatus)
def test_a_silence_and_an_answer_are_possible_at_any_time_and_nothing_is_good_after_them(
    status: IdentityStatus,
) -> None:
    for after in (met(Standing(status)), silenced(Standing(status))):
        assert not after.is_readable
        assert isinstance(not_matching(after.status, after.reason), CommandError)


def test_a_silence_leaves_how_often_fc43_had_no_answer_and_nothing_else() -> None:
    asked_twice = Answers().after("register", outcome("0")).missed("model").missed("fc43").missed("fc43", 1)

    assert asked_twice.unnamed() == Answers(misses={"fc43": (None, 1)})
    assert asked_twice.after("fc43", outcome("SSW-07")).unnamed() == Answers()


def test_a_question_that_was_not_sent_was_not_put() -> None:
    assert Answers().after("fc43", Silent("port closed", is_sent=False)) == Answers()
