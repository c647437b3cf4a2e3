"""What a message says besides its payload: how it is delivered, and how large it may be."""

from __future__ import annotations

import json

import pytest

from gateway.contract import Record
from gateway.families.devices.device import Identity
from gateway.families.profile.load import FAMILIES, LANGUAGES, load_profile
from gateway.families.profile.schema import Variant
from gateway.mqtt.connection.client import MAX_INCOMING_BYTES
from gateway.mqtt.message import message_of
from gateway.starters import StarterSetup
from gateway.starters.description import info_of
from tests.contract.examples import START, TRIP


@pytest.mark.parametrize(
    ("record", "key", "is_droppable"),
    [
        (START, "pump:start/b-11", True),
        (TRIP, "pump:trip/b-12", False),
    ],
)
def test_a_start_and_a_trip_are_queued_once_and_a_trip_goes_last_when_the_outbox_is_full(
    record: Record, key: str, *, is_droppable: bool
) -> None:
    message = message_of(record, "b")

    assert (message.qos, message.retain) == (1, False)
    assert (message.key, record.IS_DROPPABLE) == (key, is_droppable)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_info_with_all_names_is_far_below_what_brokers_and_clients_take(family: str) -> None:
    for language in LANGUAGES:
        setup = StarterSetup("p" * 64, "l" * 64, 247, load_profile(family, language), Variant(model="m" * 64))

        info = message_of(info_of(setup, setup.variant, Identity()), "b")

        assert info.packet_size < MAX_INCOMING_BYTES / 4
        assert all(
            point["name"] and point["meaning"] for point in json.loads(info.payload)["points"].values()
        )
