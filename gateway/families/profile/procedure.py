"""A command as a list of steps that are carried out, or the reason why there is none: data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gateway.contract import Note
from gateway.modbus import Request

Seen = Mapping[str, tuple[int, ...]]  # raw words by code


@dataclass(frozen=True, slots=True)
class Read:
    """A request whose answer is decoded into points or rows before anything else happens."""

    request: Request
    codes: tuple[str, ...]  # rows that the answer carries


@dataclass(frozen=True, slots=True)
class Expect:
    """The result that a read-back must show: a point's value, or a row's raw words, equal to one of these.

    Of a row that carries its value in the low byte only, `mask` leaves the rest out of the comparison. Ask
    `is_met`: it also counts the alternatives in `or_else` and the further demands in `also`, all of which
    are judged by the same reads and within the same time.
    """

    reads: tuple[Read, ...]
    name: str  # point name (value: bool, int, ...), or row code (value: tuple of raw words)
    is_one_of: tuple[Any, ...]
    within_s: float
    mask: int = 0xFFFF
    or_else: tuple[Expect, ...] = ()  # any of these is as good
    also: tuple[Expect, ...] = ()  # all of these must hold as well

    def is_met(self, values: Mapping[str, Any]) -> bool:
        """Return whether these values show it: points by name, rows by code; unknown shows nothing."""
        value = values.get(self.name)
        if isinstance(value, tuple):
            value = tuple(word & self.mask for word in value)
        is_shown = value is not None and value in self.is_one_of
        is_any = is_shown or any(other.is_met(values) for other in self.or_else)
        return is_any and all(other.is_met(values) for other in self.also)


@dataclass(frozen=True, slots=True)
class WriteStep:
    """One write; `then` must be seen before the next step."""

    request: Request
    then: Expect | None = None
    is_silence_expected: bool = False  # the device restarts and may not answer (ssw06-es 4.3)
    is_run_off: bool = False  # run = 0: when it is not taken, nothing that follows is written
    may_be_refused: bool = False  # a refusal means that it was not needed


@dataclass(frozen=True, slots=True)
class Preparation:
    """The fresh readings that a command needs before it is built, and the rules that must hold on them."""

    reads: tuple[Read, ...]
    requires: tuple[str, ...]  # names of rules in families/command/interlock.py


@dataclass(frozen=True, slots=True)
class TakeBack:
    """When a start or a jog that did not act is taken back, by the starter's stop, and how that shows."""

    released: Expect  # run and jog read 0 while the starter obeys this line: else it may ignore the write
    at_rest: Expect  # one whose motor cannot be seen to stand is left alone


@dataclass(frozen=True, slots=True)
class Procedure:
    """The writes of a command and the readings that must follow; no steps for a `read`.

    When `is_unchanged`, the starter already holds what was asked for and nothing is written. When something
    failed after the first write, `abandon` is written; a start or a jog is taken back as `take_back` says.
    """

    steps: tuple[WriteStep, ...]
    verify: Expect | None = None
    is_unchanged: bool = False
    abandon: tuple[Request, ...] = ()
    take_back: TakeBack | None = None
    subject: str = ""  # code of the row that is set or read
    subjects: tuple[str, ...] = ()  # codes of the rows, where several were asked for at once
    notes: tuple[Note, ...] = ()  # what the operator must know with the result
    is_run_cleared: bool = False  # it begins with run = 0 (families/command/run_command.py)
    is_source: bool = False  # it chooses who commands the motor: no write of it may come long after a reading
    wears: int = 0  # how many writes go to the starter's non-volatile memory

    @property
    def is_motion(self) -> bool:
        """Return whether it starts or jogs the motor."""
        return self.take_back is not None
