"""The entities of a starter and of the gateway: platform, class, unit, and which are on at first.

A value whose quality is not good is `None`, which Home Assistant shows as unknown. No entity expires: values
that do not change are published seldom, and the availability says at once when nothing comes any more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gateway.contract import (
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    LineRecord,
    Phase,
    ResultRecord,
    StateRecord,
    ValueRecord,
    to_level,
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


_OFF = {"enabled_by_default": False}  # at first; anyone can switch it on in Home Assistant
_DIAGNOSTIC = {"entity_category": "diagnostic"}
_TOTAL = {"state_class": "total_increasing"}


def _row(
    name: str, device_class: str = "", unit: str = "", precision: int | None = None, **more: Any
) -> Component:
    """Return what a point becomes where its unit is this one; with another it has no device class."""
    return {
        "name": name,
        "unit_of_measurement": unit,
        "device_class": device_class,
        "state_class": "measurement",
        "suggested_display_precision": precision,
        **more,
    }


QUANTITIES: Mapping[str, Component] = {  # points that become sensors
    "current": _row("Current", "current", "A", 1),
    "current_pct": _row("Current of rated", "", "%", 0, **_OFF),
    "line_voltage": _row("Line voltage", "voltage", "V", 0, **_OFF),
    "output_voltage": _row("Output voltage", "voltage", "V", 0, **_OFF),
    "active_power": _row("Active power", "power", "kW", 1),
    "power_factor": _row("Power factor", "power_factor", "", 2, **_OFF),
    "line_frequency": _row("Frequency", "frequency", "Hz", 1, **_OFF),
    "torque_pct": _row("Torque", "", "%", 0, **_OFF),
    "heatsink_temperature": _row("Heatsink temperature", "temperature", "°C", 0, **_DIAGNOSTIC, **_OFF),
    "energy_kwh": _row("Energy", "energy", "kWh", 1, **_TOTAL),
    "hours_total": _row("Operating hours", "duration", "h", 1, **_TOTAL, **_OFF),
    "starts_total": _row("Starts", "", "", 0, **_TOTAL, **_OFF),
    FAULT_CODE: _row("Fault code", state_class=None, entity_category="diagnostic"),
}
THERMAL = _row("Thermal load", "", "%", 0, **_DIAGNOSTIC, **_OFF)  # its point is the family's
FLAGS: Mapping[str, Component] = {  # booleans of the state topic
    "running": {"name": "Running", "device_class": "running"},
    "fault": {"name": "Fault", "device_class": "problem"},
    "alarm": {"name": "Alarm", "device_class": "problem", **_OFF},
    "remote": {"name": "Remote", **_OFF},
}
# Home Assistant's `restart` class is none of them: it would mislead. A start that cannot be sent now must not
# wait in Home Assistant, so its quality of service is 0; nothing in a stop is computed, so nothing can fail.
BUTTONS: Mapping[str, Component] = {
    STOP: {"name": "Stop", "icon": "mdi:stop", "qos": 1, "payload_press": STOP_COMMAND},
    START: {"name": "Start", "icon": "mdi:play", "qos": 0, "command_template": COMMAND, **_OFF},
    RESET: {"name": "Reset fault", "icon": "mdi:restore", "qos": 0, "command_template": COMMAND},
}


def starter_entities(facts: SiteFacts, info: InfoRecord) -> dict[str, Component]:
    """Return a starter's components by key: those that its points can fill."""
    starter = info.starter
    points = {to_level(name): point for name, point in info.points.items()}
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
    for flag, row in FLAGS.items():
        if flag in points:
            rendered = {"payload_on": "True", "payload_off": "False"}  # as Home Assistant renders a boolean
            found[flag] = (
                _binary_sensor(row["name"], state_topic, GOOD_FLAG.format(name=flag)) | rendered | row
            )
    thermal = facts.starters[starter].thermal_point
    quantities = {
        **{point: (point, row) for point, row in QUANTITIES.items()},
        thermal: ("thermal_load", THERMAL),
    }
    for point, (key, row) in quantities.items():
        if point in points:
            topic = topics.of(ValueRecord, starter=starter, point=point)
            found[key] = _quantity(row, topic, str(points[point].get("unit", "")))
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


def _quantity(row: Component, topic: str, unit: str) -> Component:
    has_class = unit == row["unit_of_measurement"]
    fields = row | {"unit_of_measurement": unit} | ({} if has_class else {"device_class": None})
    said = {key: value for key, value in fields.items() if value not in (None, "")}
    return _sensor(row["name"], topic, GOOD_VALUE) | said


def _commands(facts: SiteFacts, starter: str) -> Iterator[tuple[str, Component]]:
    verbs = facts.verbs(starter)
    if facts.client is None or not verbs:
        return
    for verb, row in BUTTONS.items():
        if verb in verbs:
            topic = facts.topics.command(starter, facts.client, verb)
            button = {"platform": "button", "command_topic": topic, "retain": False, **row}
            # A stop can be pressed, and its result seen, as long as the gateway is there to carry it out.
            yield verb, button | (available(facts) if verb == STOP else {})
    phases = [str(phase) for phase in Phase]
    result = _event(
        "Result", facts.topics.of(ResultRecord, starter=starter, client=facts.client), RESULT, phases
    )
    yield "result", result | {"icon": "mdi:clipboard-check-outline"} | available(facts)


def _named(facts: SiteFacts, starter: str, key: str, component: Component) -> Component:
    """Return a component with the name that Home Assistant knows it by, and its entity's first name."""
    entity = "_".join(part for part in (facts.gateway, starter, key) if part).replace("-", "_")
    return {
        **component,
        "unique_id": f"{facts.object_id(starter)}_E{key}",
        "default_entity_id": f"{component['platform']}.{entity}",  # from 2025.10 on; others ignore it
        "object_id": entity,  # up to 2026.3
    }
