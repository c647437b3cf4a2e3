from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Callable

import pytest

from gateway.families.devices.device import Identity
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.starters.identity.first_contact import UNANSWERED_MOST, FirstContact, IdentityStatus
from tests.starters.rig import Rig, virtually


def asked(rig: Rig) -> list[float]:
    return [sent.at_s for sent in rig.line.sent if isinstance(sent.request, ReadDeviceIdentification)]


@virtually
async def test_a_unit_that_proves_nothing_is_asked_ever_less_often() -> None:
    rig = Rig()
    rig.unit.objects = None
    rig.telemetry.start()
    rig.poll()

    await asyncio.sleep(100.0)

    times_s = asked(rig)
    gaps_s = [round(later - earlier) for earlier, later in itertools.pairwise(times_s)]
    assert gaps_s == [2, 4, 8, 16, 32]
    assert rig.telemetry.identity_standing is IdentityStatus.UNKNOWN
    assert rig.sink.events().count("identity_unknown") == 1


@virtually
async def test_a_lost_answer_is_asked_for_again_but_not_at_once() -> None:
    rig = Rig()
    rig.telemetry.start()
    rig.line.rules.append(lose(asked_for=ReadDeviceIdentification, times=1))
    rig.poll()

    await asyncio.sleep(10.0)

    assert rig.telemetry.identity_standing is IdentityStatus.MATCHING
    first_s, second_s, _ = asked(rig)  # once more than is owed: the second answer may be the first, come late
    assert second_s - first_s > 1.9


@virtually
async def test_a_starter_that_matches_but_leaves_a_question_open_is_not_asked_for_ever() -> None:
    rig = Rig("ssw06")
    rig.telemetry.start()
    rig.line.rules.append(lose(asked_for=ReadDeviceIdentification, times=1000))
    rig.poll()

    await asyncio.sleep(1000.0)

    assert rig.telemetry.identity_standing is IdentityStatus.MATCHING
    assert len(asked(rig)) == UNANSWERED_MOST


@virtually
async def test_a_silence_ends_an_identification_under_way() -> None:
    rig = Rig()
    rig.unit.objects = None
    rig.telemetry.start()
    rig.poll()
    await asyncio.sleep(1.0)
    rig.lose()

    await asyncio.sleep(100.0)

    assert len(asked(rig)) == 1


@virtually
async def test_an_error_inside_is_logged_and_leaves_the_identity_unknown(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rig = Rig()

    def fail(identity: Identity) -> None:
        raise RuntimeError("a bug")

    contact = FirstContact(rig.setup, rig.line, on_rows=lambda _: None, on_identity=fail)

    with caplog.at_level(logging.ERROR):
        contact.begin(is_known=False)
        await asyncio.sleep(1.0)

    assert "task=first contact pump-1 ended by a bug" in caplog.text


@virtually
async def test_closing_before_anything_began_does_nothing() -> None:
    rig = Rig()

    await rig.telemetry.close()

    assert rig.sink.records == []


def lose(*, asked_for: type[ReadDeviceIdentification], times: int) -> Callable[[Request], Outcome | None]:
    left = [times]

    def rule(request: Request) -> Outcome | None:
        if isinstance(request, asked_for) and left[0] > 0:
            left[0] -= 1
            return Silent()
        return None

    return rule
