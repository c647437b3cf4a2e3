"""Results of commands: each a code of a closed list, one of its texts, and the fields of that text. Pure.

Product code says which code, which case of it and with which fields; the words are in texts/results.toml. A
code or case that the table does not have, a field that its text does not name, or a field too few, is an
error: `tests/contract/test_uses.py` finds each of them without running the code.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass

from gateway.contract.wording import Meaning, table
from gateway.errors import GatewayError

ResultCode = enum.StrEnum(  # the value of each is its name in lower case; in the groups of the table
    "ResultCode",
    "OK UNCHANGED "
    "NOT_SEEN NOT_FOLLOWED RUN_NOT_CLEARED NOT_READABLE CRASHED NOT_ALL NO_ANSWER LINE_DOWN STOPPED_FIRST "
    "INTERNAL "
    "ILLEGAL_FUNCTION ILLEGAL_DATA_ADDRESS ILLEGAL_DATA_VALUE SERVER_DEVICE_FAILURE ACKNOWLEDGE "
    "SERVER_DEVICE_BUSY MEMORY_PARITY_ERROR GATEWAY_PATH_UNAVAILABLE GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND "
    "EXCEPTION "
    "IN_LOCAL CONTROLLED_ELSEWHERE NOT_ENABLED FAULT_ACTIVE NO_FAULT_TO_RESET NOT_READY NOT_CONFIGURED "
    "MOTOR_RUNNING NO_POWER CAPACITOR_CHARGED NOT_IN_THAT_MODE NOT_SET_TO_SERIAL NOT_IN_FIRMWARE "
    "READINGS_DISAGREE OFFLINE IDENTITY_UNKNOWN IDENTITY_MISMATCH IDENTITY_CHANGED NO_START "
    "HISTORY_UNAVAILABLE NOTHING_TO_ACCEPT STATE_UNKNOWN NOT_AS_EXPECTED STATE_CHANGED SLOT_MISMATCH "
    "SLOT_UNKNOWN WORD_UNKNOWN "
    "TOO_MANY_STARTS PAUSE_TOO_SHORT FEEDER_BUSY LOCKED NOT_LOCKED LOCK_REMOVED SELECT_FIRST NOT_SELECTED "
    "SELECTION_EXPIRED SELECTED_OTHERWISE SELECTED_BY_OTHER BUSY TOO_MANY WATCHDOG_UNKEPT WEAR_LIMIT "
    "NOT_ALLOWED NOT_STORED NOT_KEPT SHUTTING_DOWN "
    "RETAINED EXPIRED NOT_FRESH WRONG_BOOT BEFORE_CONNECTION MALFORMED_TOPIC NO_ID ID_REUSED UNKNOWN_STARTER "
    "UNKNOWN_VERB GROUP_ONLY_STOP BAD_ARGUMENTS BAD_EXPECT BAD_JSON BAD_PAYLOAD TOO_BIG UNKNOWN_PARAMETER "
    "NOT_WRITABLE OUT_OF_RANGE BAD_VALUE WOULD_CUT_CONNECTION TIMEOUT_UNSET",
)


_GROUPS = table("results")
NOTES: Mapping[str, str] = _GROUPS.pop("notes")  # by case
RESULTS: Mapping[str, Meaning] = {
    code: Meaning(group=group["title"], **row)
    for group in _GROUPS.values()
    for code, row in group.items()
    if code != "title"
}


def meaning_of(code: str) -> Meaning:
    """Return what a code means; one that is not in the list is a Modbus exception of another number."""
    return RESULTS.get(code) or RESULTS[ResultCode.EXCEPTION]


@dataclass(frozen=True, slots=True, init=False)
class Note:
    """A remark of a result besides its reason."""

    text: str

    def __init__(self, case: str, /, **fields: object) -> None:
        object.__setattr__(self, "text", NOTES[case].format_map(fields))


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """Why a command ended as it did, or what its phase means: a code, and a text made from the table."""

    code: str
    text: str

    def __init__(self, code: ResultCode, case: str = "", /, **fields: object) -> None:
        word = f"{code}_{fields['number']}" if code is ResultCode.EXCEPTION else code.value
        object.__setattr__(self, "code", word)
        object.__setattr__(self, "text", RESULTS[code].texts[case].format_map(fields))

    def noted(self, *more: Note | Reason | None) -> Reason:
        """Return the same reason with more to say."""
        noted = copy(self)
        object.__setattr__(noted, "text", joined(self.text, *(each.text for each in more if each)))
        return noted


def joined(*texts: str) -> str:
    """Return texts as one; empty ones say nothing."""
    return "; ".join(filter(None, texts))


class CommandError(GatewayError):
    """A command that cannot be carried out as asked, and the reason: a code with the fields of its text."""

    def __init__(self, code: ResultCode | Reason, case: str = "", /, **fields: object) -> None:
        self.reason = code if isinstance(code, Reason) else Reason(code, case, **fields)
        self.code, self.text = self.reason.code, self.reason.text
        super().__init__(f"{self.code}: {self.text}")
