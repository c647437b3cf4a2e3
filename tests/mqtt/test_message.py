"""How large a message may be."""

from __future__ import annotations

import json

import pytest

from gateway.families.devices.device import Identity
from gateway.families.profile.load import FAMILIES, LANGUAGES, load_profile
from gateway.families.profile.schema import Variant
from gateway.mqtt.connection.client import MAX_INCOMING_BYTES
from gateway.mqtt.message import message_of
from gateway.starters import StarterSetup
from gateway.starters.description import info_of


@pytest.mark.parametrize("family", FAMILIES)
def test_an_info_with_all_names_is_far_below_what_brokers_and_clients_take(family: str) -> None:
    for language in LANGUAGES:
        setup = StarterSetup("p" * 64, "l" * 64, 247, load_profile(family, language), Variant(model="m" * 64))

        info = message_of(info_of(setup, setup.variant, Identity()), "b")

        assert info.packet_size < MAX_INCOMING_BYTES / 4
        assert all(
            point["name"] and point["meaning"] for point in json.loads(info.payload)["points"].values()
        )
