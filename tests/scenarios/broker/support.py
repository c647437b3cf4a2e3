"""What the rows of the broker share: waits, orders and ages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.rig import RigPlant
from tests.rig.rows import Expectation

TRIP, HEAL = "pump trip E05", "pump clear"


def broker(**fields: Any) -> Callable[[RigPlant], None]:
    """Set something of the broker: `broker(refuses=0x86)`."""

    def act(plant: RigPlant) -> None:
        for name, value in fields.items():
            setattr(plant.broker, name, value)

    return act


def codes(topic: str, *expected: str, since: float = 0.0) -> Expectation:
    """The codes of all events of a topic, in order, but for what the settings are like."""

    def check(plant: RigPlant) -> str:
        found = [each.json["code"] for each in plant.messages(topic, since)]
        found = [each for each in found if each != "readiness"]
        return "" if found == list(expected) else f"expected {list(expected)}, found {found}"

    return check


def count(topic: str, at_most: int, since: float = 0.0, at_least: int = 0) -> Expectation:
    """So many messages came on the topics of a filter."""

    def check(plant: RigPlant) -> str:
        found = len(plant.messages(topic, since))
        return "" if at_least <= found <= at_most else f"{found} messages of {topic}"

    return check


def order(*wanted: tuple[str, dict[str, Any]], since: float = 0.0) -> Expectation:
    """The first such message of each topic came after that of the topic before."""

    def check(plant: RigPlant) -> str:
        places = []
        for topic, fields in wanted:
            places_of = set(map(id, plant.messages(topic, since)))
            found = [
                place
                for place, each in enumerate(plant.broker.log)
                if id(each) in places_of and each.payload and fields.items() <= each.json.items()
            ]
            if not found:
                return f"nothing of {topic} with {fields}"
            places.append(found[0])
        return "" if places == sorted(places) else f"in another order: {places} of {wanted}"

    return check


def afresh(since: float) -> Expectation:
    """Every retained topic came once more after a moment, all of them before `online`."""

    def check(plant: RigPlant) -> str:
        log = [each for each in plant.broker.log if each.at_s >= since and each.client == "plant"]
        online = [
            place
            for place, each in enumerate(log)
            if each.topic.endswith("gateway/status") and each.json["state"] == "online"
        ]
        if not online:
            return "the gateway is not online"
        before = {each.topic for each in log[: online[0]]}
        slow = ("/gateway/outbox", "/gateway/fresh", "/gateway/line/", "/gateway/status")
        late = [
            topic
            for topic in plant.broker.retained
            if topic not in before
            and not any(each in topic for each in slow)
            and topic.startswith(plant.base)
        ]
        return f"not published before online: {late}" if late else ""

    return check
