"""`[sparkplug]`: what it may say, and what becomes of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.app.integrations.sparkplug import settings_of
from gateway.errors import ConfigError
from gateway.mqtt.connection.reconnect import Version
from tests.sparkplug.sites import site


def problems(folder: Path, table: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        site(folder, table)
    return [f"{each.key}: {each.what}" for each in caught.value.problems]


def test_servers_of_its_own_have_a_login_of_their_own(tmp_path: Path) -> None:
    table = """
[sparkplug]
group = "plant"
node = "Gateway 1"
urls = ["mqtts://one.example", "mqtts://two.example:9999"]
username = "edge"
password_file = "own.password"
mqtt_version = "3.1.1"
primary_host = "scada"
commands = true
operator = "scada"
"""
    settings = settings_of(site(tmp_path, table), seed=1)

    assert [(each.host, each.port) for each in settings.servers] == [
        ("one.example", 8883),
        ("two.example", 9999),
    ]
    assert {(each.username, each.password) for each in settings.servers} == {
        ("edge", "secret of own.password")
    }
    assert all(each.tls is not None and each.version is Version.V311 for each in settings.servers)
    assert (settings.node, settings.primary_host, settings.operator) == ("Gateway 1", "scada", "scada")
    assert "secret of" not in repr(settings)
