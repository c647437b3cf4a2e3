"""The entities of a starter and of the gateway: platform, class, unit, and which are on at first.

A value whose quality is not good is `None`, which Home Assistant shows as unknown. No entity expires: values
that do not change are published seldom, and the availability says at once when nothing comes any more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.contract import (
    AvailabilityRecord,
    EventRecord,
    LineRecord,
    Phase,
    ResultRecord,
    StateRecord,
    ValueRecord,
)
from gateway.plugins.homeassistant.site_facts import RESET, START, STOP, SiteFacts

Component = dict[str, Any]

FAULT_CODE = "fault_code"
STATES = ("ready", "starting", "running", "stopping", "fault", "not_ready", "unknown")
GATEWAY_STATES = ("starting", "online", "degraded", "offline")
GOOD_VALUE = "{{ value_json.value if value_json.quality == 'good' else None }}"
GOOD_STATE = "{{ value_json.state if value_json.quality == 'good' else None }}"
GOOD_FLAG = "{{{{ value_json.get('{name}') if value_json.quality == 'good' else None }}}}"
BUSY = "{{ (value_json.utilisation * 100) | round(1) }}"
STATE_ATTRIBUTES = (
    "{{ {'reason': value_json.get('reason', ''), 'locked_by': (value_json.get('locked') or {}).get('by')}"
    " | tojson }}"
)
GATEWAY_IS_ON = "{{ 'online' if value_json.state in ('online', 'degraded') else 'offline' }}"
STARTER_IS_ON = "{{ 'offline' if value_json.state in ('offline', 'disabled') else 'online' }}"
# Of the state, since the point keeps the number of the last fault (SSW-07, P014).
FAULT_NUMBER = "{{ value_json.get('fault_code') if value_json.quality == 'good' else None }}"
# A range above 100000 is refused by Home Assistant's sandbox, and it has no function for a UUID.
COMMAND = (
    '{"id":"ha-{{ utcnow().timestamp() }}-{{ range(10000, 99999) | random }}",'
    '"issued_at":"{{ utcnow().isoformat() }}","ttl_s":5,"operator":"home-assistant"}'
)
STOP_COMMAND = '{"operator":"home-assistant"}'  # nothing to be computed, so nothing that can fail
TROUBLE_CODES = ("fault", "alarm", "cleared")  # of a starter's events
TROUBLE = (
    "{% if value_json.code in "
    f"{TROUBLE_CODES}"
    " %}{{ {'event_type': value_json.code, 'text': value_json.text, 'severity': value_json.severity,"
    " 'time': value_json.time} | tojson }}{% endif %}"
)
RESULT = (
    "{{ {'event_type': value_json.phase, 'verb': value_json.verb, 'code': value_json.code,"
    " 'text': value_json.text, 'id': value_json.id, 'duplicate': value_json.duplicate} | tojson }}"
)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A point that becomes a sensor; `units` are those that the device class permits, ours among them."""

    point: str
    name: str
    device_class: str | None = None
    units: tuple[str, ...] = ()  # with another one the sensor has no device class
    precision: int | None = None
    state_class: str | None = "measurement"
    is_on: bool = False  # at first; anyone can switch it on in Home Assistant
    is_diagnostic: bool = False


QUANTITIES = (
    Quantity("current", "Current", "current", ("A",), 1, is_on=True),
    Quantity("current_pct", "Current of rated", None, ("%",), 0),
    Quantity("line_voltage", "Line voltage", "voltage", ("V",), 0),
    Quantity("output_voltage", "Output voltage", "voltage", ("V",), 0),
    Quantity("active_power", "Active power", "power", ("kW",), 1, is_on=True),
    Quantity("power_factor", "Power factor", "power_factor", ("",), 2),
    Quantity("line_frequency", "Frequency", "frequency", ("Hz",), 1),
    Quantity("torque_pct", "Torque", None, ("%",), 0),
    Quantity("heatsink_temperature", "Heatsink temperature", "temperature", ("°C",), 0, is_diagnostic=True),
    Quantity("energy_kwh", "Energy", "energy", ("kWh",), 1, "total_increasing", is_on=True),
    Quantity("hours_total", "Operating hours", "duration", ("h",), 1, "total_increasing"),
    Quantity("starts_total", "Starts", None, ("",), 0, "total_increasing"),
    Quantity(FAULT_CODE, "Fault code", None, ("",), None, None, is_on=True, is_diagnostic=True),
)
THERMAL = Quantity("", "Thermal load", None, ("%",), 0, is_diagnostic=True)  # its point is the family's


@dataclass(frozen=True, slots=True)
class Flag:
    """A boolean of the state topic that becomes a binary sensor."""

    point: str
    name: str
    device_class: str | None
    is_on: bool


FLAGS = (
    Flag("running", "Running", "running", is_on=True),
    Flag("fault", "Fault", "problem", is_on=True),
    Flag("alarm", "Alarm", "problem", is_on=False),
    Flag("remote", "Remote", None, is_on=False),
)


@dataclass(frozen=True, slots=True)
class Button:
    """A verb that becomes a button. Home Assistant's `restart` class is none of them: it would mislead."""

    verb: str
    name: str
    icon: str
    qos: int  # 0: a start that Home Assistant cannot send now must not wait there
    is_on: bool


BUTTONS = (
    Button(STOP, "Stop", "mdi:stop", 1, is_on=True),
    Button(START, "Start", "mdi:play", 0, is_on=False),
    Button(RESET, "Reset fault", "mdi:restore", 0, is_on=True),
)


def starter_entities(
    facts: SiteFacts, starter: str, points: Mapping[str, Mapping[str, Any]]
) -> dict[str, Component]:
    """Return a starter's components by key; `points` are those of its `info`."""
    topics = facts.topics
    state_topic = topics.of(StateRecord, starter=starter)
    found = {
        "state": _sensor(None, state_topic, GOOD_STATE)
        | {"device_class": "enum", "options": list(STATES)}
        | {"json_attributes_topic": state_topic, "json_attributes_template": STATE_ATTRIBUTES},
        "online": _binary_sensor("Online", topics.of(AvailabilityRecord, starter=starter), STARTER_IS_ON)
        | {"payload_on": "online", "payload_off": "offline", "device_class": "connectivity"}
        | {"entity_category": "diagnostic"}
        | available(facts),  # while the starter is not
    }
    for flag in FLAGS:
        if flag.point in points:
            found[flag.point] = _flag(flag, state_topic)
    thermal = facts.starters[starter].thermal_point
    for key, point, quantity in (
        *((each.point, each.point, each) for each in QUANTITIES),
        ("thermal_load", thermal, THERMAL),
    ):
        if point in points:
            found[key] = _quantity(
                quantity,
                topics.of(ValueRecord, starter=starter, point=point),
                str(points[point].get("unit", "")),
            )
    if FAULT_CODE in found:
        found[FAULT_CODE] |= {"state_topic": state_topic, "value_template": FAULT_NUMBER}
    found["trouble"] = _event(
        "Faults and alarms", topics.of(EventRecord, starter=starter), TROUBLE, TROUBLE_CODES
    ) | {"icon": "mdi:alert"}
    found |= _commands(facts, starter)
    return {key: _named(facts, starter, key, component) for key, component in found.items()}


def gateway_entities(facts: SiteFacts) -> dict[str, Component]:
    """Return the gateway's own components by key."""
    status = facts.topics.gateway_status
    found = {
        "status": _sensor(None, status, "{{ value_json.state }}")
        | {"device_class": "enum", "options": list(GATEWAY_STATES), "entity_category": "diagnostic"},
        "boot": _sensor("Run", status, "{{ value_json.boot }}")
        | {"entity_category": "diagnostic", "enabled_by_default": False},
    }
    for line in facts.lines:
        found[f"line_{line}"] = (
            _sensor(f"Line {line}", facts.topics.of(LineRecord, line=line), BUSY)
            | {"unit_of_measurement": "%", "state_class": "measurement", "suggested_display_precision": 0}
            | {"entity_category": "diagnostic", "icon": "mdi:serial-port"}
            | available(facts)
        )
    return {key: _named(facts, "", key, component) for key, component in found.items()}


def available(facts: SiteFacts, starter: str = "") -> Component:
    """Return when entities are available: the gateway is connected, and so is a starter that is named."""
    rules = [{"topic": facts.topics.gateway_status, "value_template": GATEWAY_IS_ON}]
    if starter:
        rules.append(
            {"topic": facts.topics.of(AvailabilityRecord, starter=starter), "value_template": STARTER_IS_ON}
        )
    return {"availability": rules, "availability_mode": "all"}


def _sensor(name: str | None, topic: str, template: str) -> Component:
    """Return what all sensors have; without a name the entity has its device's."""
    return {"platform": "sensor", "name": name, "state_topic": topic, "value_template": template, "qos": 1}


def _binary_sensor(name: str, topic: str, template: str) -> Component:
    return {**_sensor(name, topic, template), "platform": "binary_sensor"}


def _event(name: str, topic: str, template: str, types: Sequence[str]) -> Component:
    return {**_sensor(name, topic, template), "platform": "event", "event_types": list(types)}


def _flag(flag: Flag, topic: str) -> Component:
    component = _binary_sensor(flag.name, topic, GOOD_FLAG.format(name=flag.point))
    component |= {"payload_on": "True", "payload_off": "False"}  # as Home Assistant renders a boolean
    if flag.device_class is not None:
        component["device_class"] = flag.device_class
    return component | _switched(is_on=flag.is_on)


def _quantity(quantity: Quantity, topic: str, unit: str) -> Component:
    component = _sensor(quantity.name, topic, GOOD_VALUE)
    if unit:
        component["unit_of_measurement"] = unit
    if quantity.device_class is not None and unit in quantity.units:
        component["device_class"] = quantity.device_class
    if quantity.state_class is not None:
        component["state_class"] = quantity.state_class
    if quantity.precision is not None:
        component["suggested_display_precision"] = quantity.precision
    if quantity.is_diagnostic:
        component["entity_category"] = "diagnostic"
    return component | _switched(is_on=quantity.is_on)


def _commands(facts: SiteFacts, starter: str) -> Iterator[tuple[str, Component]]:
    verbs = facts.verbs(starter)
    if facts.client is None or not verbs:
        return
    for button in BUTTONS:
        if button.verb in verbs:
            component = _button(button, facts.topics.command(starter, facts.client, button.verb))
            # A stop can be pressed, and its result seen, as long as the gateway is there to carry it out.
            yield button.verb, component | (available(facts) if button.verb == STOP else {})
    phases = [str(phase) for phase in Phase]
    result = _event(
        "Result", facts.topics.of(ResultRecord, starter=starter, client=facts.client), RESULT, phases
    )
    yield "result", result | {"icon": "mdi:clipboard-check-outline"} | available(facts)


def _button(button: Button, topic: str) -> Component:
    is_stop = button.verb == STOP
    return {
        "platform": "button",
        "name": button.name,
        "icon": button.icon,
        "command_topic": topic,
        **({"payload_press": STOP_COMMAND} if is_stop else {"command_template": COMMAND}),
        "qos": button.qos,
        "retain": False,
        **_switched(is_on=button.is_on),
    }


def _switched(*, is_on: bool) -> Component:
    return {} if is_on else {"enabled_by_default": False}


def _named(facts: SiteFacts, starter: str, key: str, component: Component) -> Component:
    """Return a component with the name that Home Assistant knows it by, and its entity's first name."""
    entity = "_".join(part for part in (facts.gateway, starter, key) if part).replace("-", "_")
    return {
        **component,
        "unique_id": f"{facts.object_id(starter)}_E{key}",
        "default_entity_id": f"{component['platform']}.{entity}",  # from 2025.10 on; others ignore it
        "object_id": entity,  # up to 2026.3
    }
