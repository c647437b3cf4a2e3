"""Devices of another family than configured, and what they do with the questions who they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gateway.families.profile.load import FAMILIES
from gateway.modbus.codes import ExceptionCode, Function
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import encode_exception
from gateway.records import Quality, StateRecord, ValueRecord
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter

PAIRS = [(is_, said) for is_ in FAMILIES for said in FAMILIES if is_ != said]
DEAF_S = 1.0
LATE = ("sst", "ssw06")  # its replies are mostly too late for that family, and often for an SSW-07

Answer = Callable[[bytes, float], bytes | None]
Habit = Callable[[SimulatedUnit, Answer], Answer]


def as_printed(unit: SimulatedUnit, answer: Answer) -> Answer:
    return answer


def refuses_fc43(unit: SimulatedUnit, answer: Answer) -> Answer:
    """Answer FC43 as a device without it does."""

    def handle(pdu: bytes, now_s: float) -> bytes | None:
        reply = answer(pdu, now_s)
        is_asked = pdu[0] == Function.ENCAPSULATED
        return encode_exception(pdu[0], ExceptionCode.ILLEGAL_FUNCTION) if is_asked else reply

    return handle


def silent_to_fc43(unit: SimulatedUnit, answer: Answer) -> Answer:
    return lambda pdu, now_s: answer(pdu, now_s) if pdu[0] != Function.ENCAPSULATED else None


def deaf_after_fc43(unit: SimulatedUnit, answer: Answer) -> Answer:
    return _deaf_after(lambda function: function == Function.ENCAPSULATED, answer)


def deaf_after_an_unknown_function(unit: SimulatedUnit, answer: Answer) -> Answer:
    return _deaf_after(lambda function: function not in unit.functions, answer)


def named_unknown(unit: SimulatedUnit, answer: Answer) -> Answer:
    """Answer FC43 as a device of another maker."""

    def handle(pdu: bytes, now_s: float) -> bytes | None:
        reply = answer(pdu, now_s)
        if pdu[0] != Function.ENCAPSULATED:
            return reply
        objects = {0: "ACME", 1: "CFW-11", 2: "V1.00"}
        return ReadDeviceIdentification().encode_reply(DeviceIdentification(objects), conformity=0x81)

    return handle


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


def _deaf_after(makes_deaf: Callable[[int], bool], answer: Answer) -> Answer:
    until_s = 0.0

    def handle(pdu: bytes, now_s: float) -> bytes | None:
        nonlocal until_s
        if makes_deaf(pdu[0]):
            until_s = now_s + DEAF_S
        return None if now_s < until_s else answer(pdu, now_s)

    return handle


HABITS: tuple[Habit, ...] = (
    as_printed,
    refuses_fc43,
    silent_to_fc43,
    deaf_after_fc43,
    deaf_after_an_unknown_function,
    named_unknown,
)


def device(family: str, seed: int, habit: Habit) -> SimulatedUnit:
    unit: Any = make_unit(family, 1, seed=seed)
    unit.handle = habit(unit, unit.handle)
    return unit  # type: ignore[no-any-return]


def good_values(here: OneStarter) -> list[ValueRecord | StateRecord]:
    published = [*here.sink.of(ValueRecord), *here.sink.of(StateRecord)]
    return [record for record in published if record.quality is Quality.GOOD]


def is_fc43(pdu: bytes) -> bool:
    return pdu[0] == Function.ENCAPSULATED
