"""Devices and what they do with the questions who they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gateway.modbus.codes import Function
from gateway.modbus.pdu import encode_exception
from gateway.records import Quality, StateRecord, ValueRecord
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter

Answer = Callable[[bytes, float], bytes | None]
Habit = Callable[[SimulatedUnit, Answer], Answer]


def as_printed(unit: SimulatedUnit, answer: Answer) -> Answer:
    return answer


def at_first(times: int, is_meant: Callable[[bytes], bool], *, code: int | None) -> Habit:
    """Answer so many of these requests with an exception, or not at all where there is no code."""

    def habit(_: object, answer: Answer) -> Answer:
        left = [times]

        def handle(pdu: bytes, now_s: float) -> bytes | None:
            if not is_meant(pdu) or not left[0]:
                return answer(pdu, now_s)
            left[0] -= 1
            return None if code is None else encode_exception(pdu[0], code)

        return handle

    return habit


def device(family: str, seed: int, habit: Habit) -> SimulatedUnit:
    unit: Any = make_unit(family, 1, seed=seed)
    unit.handle = habit(unit, unit.handle)
    return unit  # type: ignore[no-any-return]


def good_values(here: OneStarter) -> list[ValueRecord | StateRecord]:
    published = [*here.sink.of(ValueRecord), *here.sink.of(StateRecord)]
    return [record for record in published if record.quality is Quality.GOOD]


def is_fc43(pdu: bytes) -> bool:
    return pdu[0] == Function.ENCAPSULATED
