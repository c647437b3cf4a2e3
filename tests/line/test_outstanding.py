"""The six rules of late replies, as tables: what is listed of a unit, what comes, what follows."""

from __future__ import annotations

import pytest

from gateway.families.alternates import fences
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.line.rtu.forms import ANYONE, GIVEN_UP_S, EncodedRequest, FormChoice, Forms
from gateway.line.rtu.outstanding import EXPIRES_S, Outstanding, Shape, expected_shape, shape_of
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request, encode_exception
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import (
    MaskWriteRegister,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)
from tests.lab.late_model import WayFaults, run

READ_1, READ_2, READ_3 = (ReadHoldingRegisters(0, count) for count in (1, 2, 3))
COILS, STOP = ReadCoils(0, 16), WriteCoil(100, is_on=False)
UNIT = 7


def words(count: int) -> bytes:
    return ReadHoldingRegisters(0, count).encode_reply((0,) * count)


REFUSED_3, REFUSED_1 = encode_exception(3, 2), encode_exception(1, 2)
STOPPED, STARTED = STOP.encode(), WriteCoil(100, is_on=True).encode()


def listing(*requests: Request) -> Outstanding:
    """Return a list of these requests, asked a second apart."""
    outstanding = Outstanding()
    for asked_s, request in enumerate(requests):
        outstanding.add(UNIT, expected_shape(request), float(asked_s))
    return outstanding


def listed_in(outstanding: Outstanding) -> list[Shape]:
    return [entry.shape for entry in outstanding._lists.get(UNIT, ())]


@pytest.mark.parametrize(
    ("request_", "reply", "shape"),
    [
        (READ_2, words(2), "03 04"),
        (COILS, COILS.encode_reply((True,) * 16), "01 02"),
        (STOP, STOPPED, "05 00 64 00 00"),
        (WriteRegister(3, 7), WriteRegister(3, 7).encode(), "06 00 03 00 07"),
        (MaskWriteRegister(3, 1, 2), MaskWriteRegister(3, 1, 2).encode(), "16 00 03 00 01 00 02"),
        (WriteCoils(8, (True, False)), bytes.fromhex("0f 00 08 00 02"), "0f 00 08 00 02"),
        (WriteRegisters(8, (1, 2)), bytes.fromhex("10 00 08 00 02"), "10 00 08 00 02"),
        (ReadDeviceIdentification(), bytes.fromhex("2b 0e 01 51 00 00 00"), "2b"),
    ],
)
def test_a_shape_distinguishes_replies_of_a_unit(request_: Request, reply: bytes, shape: str) -> None:
    assert expected_shape(request_) == shape_of(reply) == bytes.fromhex(shape)


@pytest.mark.parametrize(
    ("listed", "forms", "fences_", "asked"),
    [
        ((), (READ_1, READ_2), (), READ_1),  # in step: as it is
        ((READ_1,), (READ_1, READ_2), (COILS,), READ_2),  # the first form whose shape is free
        ((COILS, READ_2), (READ_1, READ_2), (), READ_1),  # whatever else is listed
        ((READ_1, READ_2), (READ_1, READ_2), (READ_3,), READ_3),  # no form is free: a fence
        ((READ_1, READ_2), (READ_1, READ_2), (READ_3, COILS), COILS),  # whose refusal proves as much
        ((READ_1, COILS), (READ_1,), (READ_2, COILS), READ_2),
        ((READ_1, READ_2, COILS), (READ_1, READ_2), (COILS,), READ_2),  # none: whose reply cuts most off
        ((READ_2, READ_1, READ_2, READ_2), (READ_1, READ_2), (), READ_1),
    ],
)
def test_rule_1_ask_in_a_form_whose_shape_is_not_listed(
    listed: tuple[Request, ...], forms: tuple[Request, ...], fences_: tuple[Request, ...], asked: Request
) -> None:
    shapes, fence_shapes = ([expected_shape(each) for each in group] for group in (forms, fences_))

    place = listing(*listed).choose(UNIT, shapes, fence_shapes)

    assert (*forms, *fences_)[place] == asked


@pytest.mark.parametrize(
    ("listed", "reply", "is_believed"),
    [
        ((), words(1), True),
        ((READ_1,), words(2), True),
        ((READ_1, READ_2), words(2), False),
        ((READ_1,), REFUSED_3, False),  # of a refusal the function counts
        ((READ_1,), REFUSED_1, True),
        ((STOP,), STOPPED, False),
        ((STOP,), STARTED, True),
        ((STOP,), encode_exception(5, 6), False),
    ],
)
def test_rule_2_believe_what_nothing_listed_can_be_and_the_unit_is_in_step(
    listed: tuple[Request, ...], reply: bytes, is_believed: bool
) -> None:
    outstanding = listing(*listed)

    assert outstanding.believe(UNIT, reply) is is_believed

    assert outstanding.is_in_step(UNIT) is (is_believed or not listed)
    assert len(listed_in(outstanding)) == (0 if is_believed else len(listed))


@pytest.mark.parametrize(
    ("listed", "frame", "left"),
    [
        ((READ_1, READ_2, READ_3), words(2), (READ_3,)),  # up to and including the oldest of its shape
        ((READ_1, READ_2, READ_1), words(1), (READ_2, READ_1)),
        ((COILS, READ_1, READ_2), REFUSED_3, (READ_2,)),
        ((READ_1, READ_2), words(3), (READ_1, READ_2)),  # it was not asked for
        ((STOP, READ_1, STOP), STOPPED, (READ_1, STOP)),
        ((READ_1,), words(1), ()),
    ],
)
def test_rule_3_drop_any_other_frame_and_cut_the_list_up_to_what_it_answers(
    listed: tuple[Request, ...], frame: bytes, left: tuple[Request, ...]
) -> None:
    outstanding = listing(*listed)

    outstanding.drop(UNIT, frame)

    assert listed_in(outstanding) == [expected_shape(each) for each in left]


def test_rule_5_an_entry_expires_and_says_nothing_of_another_unit() -> None:
    outstanding = listing(READ_1, READ_2)  # asked at 0 s and 1 s

    outstanding.expire(UNIT, EXPIRES_S + 0.5)

    assert listed_in(outstanding) == [expected_shape(READ_2)]
    assert outstanding.is_in_step(UNIT + 1)


FORMS = Forms(lambda _: ((READ_2, lambda words: words[:1]),), (READ_2, COILS))


@pytest.mark.parametrize(
    ("wanted", "is_poll", "listed", "given_up", "sent"),
    [
        (READ_1, True, (), (), READ_1),
        (READ_1, True, (READ_1,), (), READ_2),  # an alternate
        (READ_1, True, (READ_1,), (READ_2,), COILS),  # a fence, where the alternate was refused
        (READ_1, False, (READ_1,), (), COILS),  # a fence: a job has no alternates
        (READ_1, False, (READ_2,), (), READ_1),
        (WriteRegister(3, 7), False, (), (), WriteRegister(3, 7)),
        (WriteRegister(3, 7), False, (READ_1,), (), COILS),  # rule 6: a write goes out in step
        (WriteRegister(3, 7), False, (READ_2, COILS), (), COILS),
        (ReadDeviceIdentification(), False, (ReadDeviceIdentification(),), (), READ_2),
    ],
)
def test_a_request_goes_out_in_its_own_form_in_another_or_behind_a_fence(
    wanted: Request,
    is_poll: bool,
    listed: tuple[Request, ...],
    given_up: tuple[Request, ...],
    sent: Request,
) -> None:
    choice = FormChoice()
    for at_s, request in enumerate(listed):
        choice.outstanding.add(UNIT, expected_shape(request), at_s)
    for refused in given_up:
        choice.give_up(EncodedRequest.of(UNIT, refused, cut=tuple), 0.0)

    chosen = choice.choose(EncodedRequest.of(UNIT, wanted), FORMS, 2.0, is_poll=is_poll)

    assert chosen.request == sent
    assert chosen.is_fence is ((sent != wanted and not is_poll) or sent == COILS)


def test_a_form_that_was_given_up_is_tried_again_after_an_hour_or_when_another_device_answers() -> None:
    choice = FormChoice()
    alternate, wanted = EncodedRequest.of(UNIT, READ_2, cut=tuple), EncodedRequest.of(UNIT, READ_1)
    choice.give_up(wanted, 0.0)  # the row's own form never is
    choice.give_up(alternate, 0.0)

    def asked(now_s: float) -> Request:
        choice.outstanding.add(UNIT, expected_shape(READ_1), now_s)
        return choice.choose(wanted, FORMS, now_s, is_poll=True).request

    assert [asked(1.0), asked(GIVEN_UP_S + 1.0)] == [COILS, READ_2]
    choice.give_up(alternate, GIVEN_UP_S)
    choice.retry_refused(UNIT)
    assert asked(GIVEN_UP_S + 1.0) == READ_2


@pytest.mark.parametrize("family", FAMILIES)
def test_each_family_has_eight_shapes_to_prove_by(family: str) -> None:
    shapes = [expected_shape(fence) for fence in fences(load_profile(family))]

    assert len(set(shapes)) == len(shapes) >= 8
    assert len({shape[0] for shape in shapes}) >= 2  # a refusal shows its function only


def test_whatever_is_asked_of_anyone_is_a_read() -> None:
    assert not any(fence.is_write for fence in ANYONE.fences)


@pytest.mark.parametrize("late_s", [0.3, 1.0, 3.0, 30.0])
def test_no_reply_is_taken_for_anothers_whatever_is_late_lost_cut_garbled_or_refused(late_s: float) -> None:
    faults = WayFaults(late_s, is_mixed=True, is_ordered_over_all=late_s == 1.0)

    found = run(faults, seed=1, requests=5000, units=4, every_s=0.25)

    assert found.wrong == 0
    assert found.answers > 0.3 * found.polls
