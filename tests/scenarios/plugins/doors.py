"""What the rows of this folder say besides the rig's words: to the page, as a Sparkplug host, at buttons."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from jinja2.sandbox import ImmutableSandboxedEnvironment

from gateway.sim.core.power import MotorData
from tests.rig import RigPlant, WebAnswer, sparkplug, that
from tests.rig.rows import Action, Expectation, _unlike

SLOW = {"motor": MotorData(ramp_up_s=5.0, full_voltage_s=0.2, ramp_down_s=0.4, coast_s=0.5)}
BRISK = {"motor": MotorData(ramp_up_s=3.0, full_voltage_s=0.2, ramp_down_s=0.2, coast_s=0.2)}
NODE = "spBv1.0/plant/{}/plant"


_numbers = itertools.count()


# The page

POLICY = "content-security-policy"
ALWAYS = {"x-frame-options": "DENY", "x-content-type-options": "nosniff", "referrer-policy": "no-referrer"}


def answer(
    path: str,
    status: int = 200,
    *,
    post: object = None,
    headers: Mapping[str, str] | None = None,
    **fields: Any,
) -> Expectation:
    """The page answers with this status, and with JSON that has these fields; with `post` to a POST.

    Whatever it answers forbids frames, foreign scripts and guessing of types.
    """

    def check(plant: RigPlant) -> str:
        found = (
            plant.get(path, **(headers or {})) if post is None else plant.post(path, post, **(headers or {}))
        )
        if found.status != status:
            return f"{path} answers {found.status}: {found.text[:400]}"
        if not found.headers.items() >= ALWAYS.items() or "default-src 'none'" not in found.headers[POLICY]:
            return f"{path} forbids too little: {found.headers}"
        wrong = _unlike(found.json, fields) if fields else ""
        return f"{path}: {wrong}: {found.text[:600]}" if wrong else ""

    return check


def log_in(user: str = "anna", password: str = "right") -> Action:
    return lambda plant: plant.browser.log_in(user, password)


def pressed(plant: RigPlant, verb: str, starter: str = "pump", **fields: Any) -> WebAnswer:
    """Press a button of the page: a command with an id and the newest token."""
    body = {"id": f"web-{next(_numbers)}", "token": plant.token(), **fields}
    return plant.post(f"/api/v1/command/{starter}/{verb}", body)


def phases(verb: str, *expected: str, starter: str = "pump", **fields: Any) -> Expectation:
    """A command by the page goes through these phases, each as `phase code`."""

    def said(plant: RigPlant) -> list[str]:
        found = pressed(plant, verb, starter, **fields).json
        return [f"{each['phase']} {each['code']}" for each in found.get("phases", ())]

    return that(said, list(expected))


# Sparkplug


def born(kind: str, device: str = "") -> str:
    """Return the topic of a Sparkplug message of this node, or of one of its devices."""
    return NODE.format(kind) + (f"/{device}" if device else "")


def write(
    metrics: Mapping[str, Any],
    device: str = "pump",
    *,
    age_s: float = 0.0,
    metric_age_s: float | None = None,
    **how: Any,
) -> Action:
    """Have a host write to a device, or to the node (`device=""`), at a time of its own."""

    def act(plant: RigPlant) -> None:
        now_s = plant.world.utc_s()
        own_s = age_s if metric_age_s is None else metric_age_s
        payload = sparkplug.encoded(metrics, time_s=now_s - own_s) + sparkplug.encoded(
            {}, time_s=now_s - age_s
        )
        plant.publish(born("DCMD" if device else "NCMD", device), payload, client="host", **{"qos": 0, **how})

    return act


# Home Assistant


def device(name: str = "pump") -> str:
    return f"homeassistant/device/sg_plant{'_' if name else ''}{name}/config"


def entity(plant: RigPlant, key: str, name: str = "pump") -> dict[str, Any]:
    """Return an entity as it is announced, with the device's availability where it has none of its own."""
    found = plant.broker.retained[device(name)].json
    return {"availability": found.get("availability"), **found["components"][key]}


def shown(key: str, value: str, name: str = "pump") -> Expectation:
    """Home Assistant shows this of an entity."""

    def check(plant: RigPlant) -> str:
        one = entity(plant, key, name)
        for each in one["availability"] or ():
            if _rendered(plant, each["value_template"], each["topic"]) != "online":
                return "" if value == "unavailable" else f"{key} is unavailable by {each['topic']}"
        found = _rendered(plant, one["value_template"], one["state_topic"])
        return "" if found == value else f"{key} is {found}"

    return check


def press(key: str, name: str = "pump", *, late_s: float = 0.0, **how: Any) -> Action:
    """Press a button as Home Assistant does: render its template and publish that."""

    def act(plant: RigPlant) -> None:
        one = entity(plant, key, name)
        payload = (
            one.get("payload_press") or _sandbox(plant, -late_s).from_string(one["command_template"]).render()
        )
        plant.publish(one["command_topic"].removeprefix(f"{plant.base}/"), payload, client="ha", **how)

    return act


def _rendered(plant: RigPlant, template: str, topic: str) -> str:
    payload = plant.broker.retained[topic].payload.decode()
    return _sandbox(plant).from_string(template).render(value=payload, value_json=json.loads(payload))


def _sandbox(plant: RigPlant, at_s: float = 0.0) -> ImmutableSandboxedEnvironment:
    sandbox = ImmutableSandboxedEnvironment()
    sandbox.globals["utcnow"] = lambda: datetime.fromtimestamp(plant.world.utc_s() + at_s, UTC)
    sandbox.filters["random"] = lambda numbers: numbers[int(plant.world.now_s() * 1000) % len(numbers)]
    return sandbox


# Prometheus

_SAMPLE = re.compile(r"starter_gateway_(\w+)(?:\{(.*)\})? (\S+)")


def samples(text: str) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    """Return the samples of a scrape, by name (without `starter_gateway_`) and labels."""
    found = (_SAMPLE.fullmatch(line) for line in text.splitlines() if not line.startswith("#"))
    return {(m[1], frozenset(re.findall(r'(\w+)="(.*?)"', m[2] or ""))): float(m[3]) for m in found if m}


def sample(name: str, value: Any = ..., **labels: str) -> Expectation:
    """A scrape has this sample with these labels, of any value, of this one, or (None) has none."""

    def check(plant: RigPlant) -> str:
        text = plant.get("/metrics").text
        found = [
            number
            for (n, of), number in samples(text).items()
            if n == name and labels.items() <= dict(of).items()
        ]
        is_right = not found if value is None else bool(found) if value is ... else found == [value]
        return "" if is_right else f"{name} {labels}: {found}"

    return check
