"""`[homeassistant]`: what may be announced where, and what each mistake says."""

from __future__ import annotations

import pytest

from gateway.config.load import parse
from gateway.errors import ConfigError
from tests.config.sites import SITE


def problems(text: str, site: str = SITE) -> list[str]:
    try:
        parse(site + text, "site.toml")
    except ConfigError as error:
        return [f"{each.key}: {each.what} ({each.hint})" for each in error.problems]
    return []


@pytest.mark.parametrize(
    "text",
    [
        "[homeassistant]\n",
        '[homeassistant]\noperator = "alice"\ncommands = true\npage_url = "https://mcc1.plant:8480/page"\n',
        '[homeassistant]\ndiscovery_prefix = "ha/one"\nbirth_topic = "ha/one/Status.1"\n',
    ],
)
def test_what_is_right_is_taken(text: str) -> None:
    assert problems(text) == []


def test_without_the_table_nothing_is_announced_and_an_empty_one_gives_no_buttons() -> None:
    assert parse(SITE, "x").home_assistant is None
    table = parse(SITE + "[homeassistant]\n", "x").home_assistant
    assert table is not None
    assert (table.operator, table.commands, table.discovery_prefix) == (None, False, "homeassistant")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('operator = "alcie"', "homeassistant.operator: 'alcie' is no [[operator]]'s client (did you mean"),
        ("commands = true", "homeassistant.commands: needs operator beside it"),
        ('birth_topic = "starters/mcc1/command/pump-1/alice/start"', "lies among the gateway's own topics"),
        ('birth_topic = "starters/mcc1"', "lies among the gateway's own topics"),
        ('discovery_prefix = "starters"', "lies among the gateway's own topics"),
        ('discovery_prefix = "starters/mcc1/gateway"', "lies among the gateway's own topics"),
        ('birth_topic = "homeassistant/#"', "homeassistant.birth_topic"),
        ('birth_topic = "spBv1.0/STATE/scada"', "homeassistant.birth_topic: lies among Sparkplug's topics"),
        ('birth_topic = "spBv1.0"', "homeassistant.birth_topic: lies among Sparkplug's topics"),
        ('discovery_prefix = "spBv1.0"', "homeassistant.discovery_prefix: lies among Sparkplug's topics"),
        ('birth_topic = "homeassistant/device/sg_mcc1/config"', "lies among the topics of discovery"),
        ('birth_topic = "homeassistant/device"', "lies among the topics of discovery"),
        ('birth_topic = "homeassistant"', "lies among the topics of discovery"),
        (
            'discovery_prefix = "ha"\nbirth_topic = "ha/device/sg_other/config"',
            "a topic outside 'ha/device', such as ha/status",
        ),
        ('birth_topic = "+/status"', "homeassistant.birth_topic"),
        ('discovery_prefix = "home/"', "homeassistant.discovery_prefix"),
        ('page_url = "mcc1.plant"', "homeassistant.page_url"),
        ("expire_after = 3", "homeassistant.expire_after"),
    ],
)
def test_a_mistake_is_named_with_its_key(text: str, found: str) -> None:
    (problem,) = problems(f"[homeassistant]\n{text}\n")

    assert found in problem


@pytest.mark.parametrize("base", ["homeassistant", "homeassistant/x", "homeassistant/device/sg_{gateway}"])
@pytest.mark.parametrize("text", ["", 'discovery_prefix = "homeassistant"\n'])
def test_a_base_among_the_topics_of_discovery_is_refused_also_by_the_default_prefix(
    base: str, text: str
) -> None:
    site = SITE.replace("[mqtt]\n", f'[mqtt]\nbase = "{base}"\n')
    assert f'base = "{base}"' in site

    (problem,) = problems(f"[homeassistant]\n{text}", site)

    assert "lies among" in problem
    assert problem.startswith("homeassistant.discovery_prefix" if text else "mqtt.base")
    assert problems("", site) == []  # without the table it is a base like any other


def test_a_prefix_that_is_the_beginning_of_a_level_only_is_another_topic() -> None:
    assert problems('[homeassistant]\ndiscovery_prefix = "starters2"\n') == []
