"""Runs inside Home Assistant's own environment: what its schemas and its templates make of ours.

Reads JSON from standard input: `components`, each with its platform, and `renders`, each a template with a
payload, or without one for a command's. Prints JSON: `mistakes` and `rendered`.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import sys
from typing import Any

import voluptuous as vol
from homeassistant.components.mqtt.models import MqttCommandTemplate, MqttValueTemplate
from homeassistant.core import HomeAssistant
from homeassistant.helpers.template import Template


async def main() -> None:
    asked = json.load(sys.stdin)
    home = HomeAssistant("/nowhere")
    rendered = [render(home, each["template"], each.get("payload")) for each in asked["renders"]]
    mistakes = [mistake for component in asked["components"] if (mistake := mistake_in(component))]
    json.dump({"mistakes": mistakes, "rendered": rendered}, sys.stdout)
    await home.async_stop(force=True)


def mistake_in(component: dict[str, Any]) -> str:
    """Return what the schema of a component's platform has against it; empty for nothing."""
    platform = component["platform"]
    schema = importlib.import_module(f"homeassistant.components.mqtt.{platform}").DISCOVERY_SCHEMA
    try:
        taken = schema({key: value for key, value in component.items() if key != "platform"})
    except vol.Invalid as error:
        return f"{component['unique_id']}: {error}"
    unknown = set(component) - {str(key) for key in taken} - {"platform", "default_entity_id", "options"}
    return f"{component['unique_id']}: ignored {sorted(unknown)}" if unknown else ""


def render(home: HomeAssistant, text: str, payload: str | None) -> str:
    template = Template(text, home)
    if payload is None:
        return str(MqttCommandTemplate(template, hass=home).async_render("PRESS"))
    return str(MqttValueTemplate(template, hass=home).async_render_with_possible_json_value(payload))


asyncio.run(main())
