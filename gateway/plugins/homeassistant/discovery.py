"""Makes the discovery messages: one retained message for each starter, and one for the gateway.

Device-based discovery, from Home Assistant 2024.11 on. Versions before 2026.11 refuse a whole device for one
key at the root that they do not know, and ignore unknown keys of a component: so the root has only what these
know, and `qos` stands in each component.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway import __version__
from gateway.contract import InfoRecord, encoded
from gateway.families import load_profile
from gateway.mqtt import Message
from gateway.plugins.homeassistant.entities import available, gateway_entities, starter_entities
from gateway.plugins.homeassistant.site_facts import SiteFacts

PRODUCT = "starter-gateway"


def starter_message(facts: SiteFacts, info: InfoRecord) -> Message:
    """Return the discovery of a starter."""
    starter = info.starter
    maker, _, kind = load_profile(info.family).title.partition(" ")
    device = {
        "identifiers": [facts.object_id(starter)],
        "name": info.title or starter,
        "manufacturer": maker,
        "model": info.model or kind,
        "serial_number": info.serial,
        "sw_version": info.firmware,
        "hw_version": info.hardware,
        "via_device": facts.gateway_id,
        "configuration_url": facts.table.page_url,
    }
    root = available(facts, starter)
    return _message(facts, starter, device, components=starter_entities(facts, info), **root)


def gateway_message(facts: SiteFacts) -> Message:
    """Return the discovery of the gateway itself, which is shown while it is away, too."""
    device = {
        "identifiers": [facts.gateway_id],
        "name": facts.config.gateway.name,
        "manufacturer": PRODUCT,
        "model": "Gateway for soft-starters",
        "sw_version": __version__,
        "configuration_url": facts.table.page_url,
    }
    return _message(facts, "", device, components=gateway_entities(facts))


def _message(facts: SiteFacts, starter: str, device: Mapping[str, Any], **root: Any) -> Message:
    """Return a discovery; what is not known of its device is left out."""
    fields = {
        "device": {key: value for key, value in device.items() if value},
        "origin": {"name": PRODUCT, "sw_version": __version__},
        **root,
    }
    return Message(facts.config_topic(starter), encoded(fields), qos=1, retain=True)
