"""What is announced: its form, names, entities and defaults."""

from __future__ import annotations

import re

import pytest

from gateway.plugins.homeassistant.site_facts import facts_of
from tests.config.sites import site
from tests.home_assistant.announced import STARTERS, announced

ROOT_KEYS = frozenset(  # others cost the whole device before Home Assistant 2026.11
    {
        *("device", "origin", "components", "availability", "availability_mode", "availability_topic"),
        *("availability_template", "payload_available", "payload_not_available"),
        *("state_topic", "command_topic", "qos", "encoding"),
    }
)
TOPIC = re.compile(r"homeassistant/device/([a-zA-Z0-9_-]+)/config")


@pytest.mark.parametrize("name", [*STARTERS, ""])
def test_the_root_has_no_key_that_costs_the_whole_device(name: str) -> None:
    found = announced()[name]

    assert set(found) <= ROOT_KEYS
    assert found["origin"]["name"] == "starter-gateway"
    assert all({"platform", "unique_id"} <= set(each) for each in found["components"].values())
    assert all("qos" in each for each in found["components"].values())  # not inherited from the root


def test_of_many_entities_only_the_useful_ones_are_on_at_first() -> None:
    on = {
        name: {
            key
            for key, each in announced()[name]["components"].items()
            if each.get("enabled_by_default", True)
        }
        for name in STARTERS
    }

    usual = {"state", "online", "running", "fault", "current", "trouble", "stop", "reset", "result"}
    assert on == {
        "pump": usual | {"fault_code"},
        "fan": usual | {"active_power", "energy_kwh"},
        "mill": usual | {"active_power", "energy_kwh", "fault_code"},
        "belt": usual,
    }


def test_no_entity_shows_a_value_without_its_quality() -> None:
    unjudged = {
        key
        for name in STARTERS
        for key, each in announced()[name]["components"].items()
        if each["platform"] in ("sensor", "binary_sensor")
        and "quality == 'good'" not in each["value_template"]
    }

    assert unjudged == {"online"}


def test_every_name_is_one_that_home_assistant_takes_and_no_two_are_the_same() -> None:
    table = ("[[operator]]", "[homeassistant]\n[[operator]]")
    ids = []
    for gateway in ("a", "a_b", "a-b", "a_", "a_u"):
        facts = facts_of(site(('name = "mcc1"', f'name = "{gateway}"'), table))
        assert facts is not None
        ids += [facts.object_id(starter) for starter in ("", "b", "b_c", "c", "_b", "u_b", "b-c")]
        assert TOPIC.fullmatch(facts.config_topic("b_c"))

    assert len(ids) == len(set(ids))
    unique = [each["unique_id"] for said in announced().values() for each in said["components"].values()]
    assert len(unique) == len(set(unique))
    assert [each for each in unique if not re.fullmatch(r"[a-zA-Z0-9_-]+", each)] == []
