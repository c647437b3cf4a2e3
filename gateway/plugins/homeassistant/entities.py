"""The entities of a starter and of the gateway: platform, class, unit, and which are on at first.

A value whose quality is not good is `None`, which Home Assistant shows as unknown. No entity expires: values
that do not change are published seldom, and the availability says at once when nothing comes any more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from gateway.contract import (
    STOP,
    AvailabilityRecord,
    EventRecord,
    GatewayState,
    InfoRecord,
    LineRecord,
    Phase,
    ResultRecord,
    StarterState,
    StateRecord,
    StatusRecord,
    ValueRecord,
    to_level,
)
from gateway.families import load_profile
from gateway.plugins.homeassistant.site_facts import SiteFacts

Component = dict[str, Any]

FAULT_CODE = "fault_code"
STATES, GATEWAY_STATES = get_args(StarterState), get_args(GatewayState)
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
FAULT_NUMBER = GOOD_FLAG.format(name=FAULT_CODE)
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


_OFF: Component = {"enabled_by_default": False}  # at first; anyone can switch it on in Home Assistant
_DIAGNOSTIC: Component = {"entity_category": "diagnostic"}
_TOTAL: Component = {"state_class": "total_increasing"}


def _row(name: str | None, template: str, platform: str = "sensor", **more: Any) -> Component:
    """Return an entity by its name, how its value is found in a message, and what else it has."""
    return {"platform": platform, "name": name, "value_template": template, **more}


def _quantity(name: str, kind: str = "", unit: str = "", digits: int | None = None, **more: Any) -> Component:
    """Return what a point becomes whose unit is this one."""
    fields = {"unit_of_measurement": unit, "device_class": kind, "suggested_display_precision": digits}
    return {**_row(name, GOOD_VALUE), **fields, "state_class": "measurement", **more}


def _flag(name: str, kind: str = "", **more: Any) -> Component:
    """Return what a boolean of the state topic becomes; Home Assistant renders it with a capital."""
    payloads = {"payload_on": "True", "payload_off": "False"}
    return {**_row(name, "", "binary_sensor", device_class=kind, **payloads), **more}


STATE = _row(None, GOOD_STATE, device_class="enum", options=STATES, json_attributes_template=STATE_ATTRIBUTES)
ONLINE = _row("Online", STARTER_IS_ON, "binary_sensor", payload_on="online", payload_off="offline")
ONLINE |= {"device_class": "connectivity", **_DIAGNOSTIC}
TROUBLES = _row("Faults and alarms", TROUBLE, "event", event_types=TROUBLE_CODES, icon="mdi:alert")
RESULTS = _row("Result", RESULT, "event", event_types=[*Phase], icon="mdi:clipboard-check-outline")
STATUS = _row(None, "{{ value_json.state }}", device_class="enum", options=GATEWAY_STATES, **_DIAGNOSTIC)
BOOT = _row("Run", "{{ value_json.boot }}", **_DIAGNOSTIC, **_OFF)
UTILISATION = _quantity("Line", "", "%", 0, value_template=BUSY, icon="mdi:serial-port", **_DIAGNOSTIC)
QUANTITIES: Mapping[str, Component] = {  # points that become sensors
    "current": _quantity("Current", "current", "A", 1),
    "current_pct": _quantity("Current of rated", "", "%", 0, **_OFF),
    "line_voltage": _quantity("Line voltage", "voltage", "V", 0, **_OFF),
    "output_voltage": _quantity("Output voltage", "voltage", "V", 0, **_OFF),
    "active_power": _quantity("Active power", "power", "kW", 1),
    "power_factor": _quantity("Power factor", "power_factor", "", 2, **_OFF),
    "line_frequency": _quantity("Frequency", "frequency", "Hz", 1, **_OFF),
    "torque_pct": _quantity("Torque", "", "%", 0, **_OFF),
    "heatsink_temperature": _quantity("Heatsink temperature", "temperature", "°C", 0, **_DIAGNOSTIC, **_OFF),
    "energy_kwh": _quantity("Energy", "energy", "kWh", 1, **_TOTAL),
    "hours_total": _quantity("Operating hours", "duration", "h", 1, **_TOTAL, **_OFF),
    "starts_total": _quantity("Starts", "", "", 0, **_TOTAL, **_OFF),
    FAULT_CODE: _quantity("Fault code", state_class=None, entity_category="diagnostic"),
}
THERMAL = _quantity("Thermal load", "", "%", 0, **_DIAGNOSTIC, **_OFF)  # its point is the family's
FLAGS: Mapping[str, Component] = {  # booleans of the state topic
    "running": _flag("Running", "running"),
    "fault": _flag("Fault", "problem"),
    "alarm": _flag("Alarm", "problem", **_OFF),
    "remote": _flag("Remote", **_OFF),
}
# Home Assistant's `restart` class is none of them: it would mislead. A start that cannot be sent now must not
# wait in Home Assistant, so its quality of service is 0; nothing in a stop is computed, so nothing can fail.
BUTTONS: Mapping[str, Component] = {
    STOP: {"name": "Stop", "icon": "mdi:stop", "qos": 1, "payload_press": STOP_COMMAND},
    "start": {"name": "Start", "icon": "mdi:play", "qos": 0, "command_template": COMMAND, **_OFF},
    "reset": {"name": "Reset fault", "icon": "mdi:restore", "qos": 0, "command_template": COMMAND},
}


CLASSES = {  # of a unit, for points that only a configuration asks for
    "A": "current",
    "V": "voltage",
    "kW": "power",
    "Hz": "frequency",
    "°C": "temperature",
    "s": "duration",
    "h": "duration",
    "kWh": "energy",
}
LABEL = "{{ value_json.label or value_json.value if value_json.quality == 'good' else None }}"


def starter_entities(facts: SiteFacts, info: InfoRecord) -> dict[str, Component]:
    """Return a starter's components by key: those that its points can fill."""
    starter = info.starter
    points = {to_level(name): point for name, point in info.points.items()}
    topics = facts.topics
    state_topic = topics.of(StateRecord, starter=starter)
    availability_topic = topics.of(AvailabilityRecord, starter=starter)
    found = {
        "state": _entity(state_topic, STATE | {"json_attributes_topic": state_topic}),
        "online": _entity(availability_topic, ONLINE | available(facts)),  # while the starter is not
    }
    for flag, row in FLAGS.items():
        if flag in points:
            found[flag] = _entity(state_topic, row | {"value_template": GOOD_FLAG.format(name=flag)})
    thermal = load_profile(info.family).thermal_point
    for point, row in {**QUANTITIES, thermal: THERMAL}.items():
        if point in points:
            topic = topics.of(ValueRecord, starter=starter, point=point)
            key = "thermal_load" if row is THERMAL else point
            found[key] = _entity(topic, _in_unit(row, str(points[point].get("unit", ""))))
    for point, said in points.items():
        if "every_s" in said:  # only the configuration asks for it
            found[point] = _entity(topics.of(ValueRecord, starter=starter, point=point), _extra(said))
    if FAULT_CODE in found:
        found[FAULT_CODE] |= {"state_topic": state_topic, "value_template": FAULT_NUMBER}
    found["trouble"] = _entity(topics.of(EventRecord, starter=starter), TROUBLES)
    found |= _commands(facts, starter)
    return {key: _named(facts, starter, key, component) for key, component in found.items()}


def gateway_entities(facts: SiteFacts) -> dict[str, Component]:
    """Return the gateway's own components by key."""
    status = facts.topics.of(StatusRecord)
    found = {"status": _entity(status, STATUS), "boot": _entity(status, BOOT)}
    for line in facts.config.lines:
        row = {**UTILISATION, "name": f"Line {line.name}", **available(facts)}
        found[f"line_{line.name}"] = _entity(facts.topics.of(LineRecord, line=line.name), row)
    return {key: _named(facts, "", key, component) for key, component in found.items()}


def available(facts: SiteFacts, starter: str = "") -> Component:
    """Return when entities are available: the gateway is connected, and so is a starter that is named."""
    rules = [{"topic": facts.topics.of(StatusRecord), "value_template": GATEWAY_IS_ON}]
    if starter:
        rules.append(
            {"topic": facts.topics.of(AvailabilityRecord, starter=starter), "value_template": STARTER_IS_ON}
        )
    return {"availability": rules, "availability_mode": "all"}


def _entity(topic: str, row: Component) -> Component:
    """Return a row of the tables as it is announced; without a name it has its device's."""
    said = {key: value for key, value in row.items() if value not in (None, "")}
    return {"name": None, "state_topic": topic, "qos": 1, **said}


def _extra(said: Mapping[str, Any]) -> Component:
    """Return what a point becomes that only the configuration asks for: off at first."""
    name, unit, kind = str(said["name"]), str(said["unit"]), said["type"]
    if kind == "boolean":
        return _flag(name, value_template=GOOD_VALUE, **_OFF)
    if kind in ("enum", "string"):
        return _row(name, LABEL, **_OFF)
    of_unit = CLASSES.get(unit, "")
    return _quantity(
        name, of_unit, unit, state_class="total" if of_unit == "energy" else "measurement", **_OFF
    )


def _in_unit(row: Component, unit: str) -> Component:
    """Return what a point becomes: with another unit than the table's it has no device class."""
    device_class = row["device_class"] if unit == row["unit_of_measurement"] else ""
    return row | {"unit_of_measurement": unit, "device_class": device_class}


def _commands(facts: SiteFacts, starter: str) -> Iterator[tuple[str, Component]]:
    client, verbs = facts.client, facts.verbs(starter, BUTTONS)
    for verb in verbs:
        topic = facts.topics.command(starter, client, verb)
        button = {"platform": "button", "command_topic": topic, "retain": False, **BUTTONS[verb]}
        # A stop can be pressed, and its result seen, as long as the gateway is there to carry it out.
        yield verb, button | (available(facts) if verb == STOP else {})
    if verbs:
        topic = facts.topics.of(ResultRecord, starter=starter, client=client)
        yield "result", _entity(topic, RESULTS | available(facts))


def _named(facts: SiteFacts, starter: str, key: str, component: Component) -> Component:
    """Return a component with the name that Home Assistant knows it by, and its entity's first name."""
    entity = "_".join(part for part in (facts.config.gateway.name, starter, key) if part).replace("-", "_")
    return {
        **component,
        "unique_id": f"{facts.object_id(starter)}_E{key}",
        "default_entity_id": f"{component['platform']}.{entity}",  # from 2025.10 on; others ignore it
        "object_id": entity,  # up to 2026.3
    }
