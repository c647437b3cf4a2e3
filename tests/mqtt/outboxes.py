"""An outbox with plain messages to put into it."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.mqtt.contract.payloads import LateValue, Message
from gateway.mqtt.outbox.outbox import Outbox, Outgoing

STATUS = "b/gateway/status"
WIDE = 1000  # a window that never fills


def pack(topic: str, items: Sequence[str], boot: str) -> Message:
    assert boot == "run"
    return Message(topic, ",".join(items).encode(), qos=1, retain=False, is_queued=True, is_droppable=True)


def outbox(**limits: int) -> Outbox:
    box = Outbox(last_topic=STATUS, pack=pack, late=late, boot="run", **limits)
    box.grant_history(10**6)
    return box


def late(message: Message) -> LateValue:
    return LateValue(message.topic.replace("v/", "h/"), message.payload)


def latest(topic: str, text: str = "", *, qos: int = 1, is_value: bool = False) -> Message:
    return Message(topic, text.encode(), qos=qos, retain=True, is_value=is_value)


def value(number: int, *, starter: str = "p") -> Message:
    return latest(f"v/{starter}", str(number), is_value=True)


def event(text: str) -> Message:
    return Message("e", text.encode(), qos=1, retain=False, is_queued=True, is_droppable=True)


def result(text: str) -> Message:
    return Message("r", text.encode(), qos=1, retain=False, is_queued=True)


def take_all(box: Outbox) -> list[Outgoing]:
    taken: list[Outgoing] = []
    while (outgoing := box.take()) is not None:
        taken.append(outgoing)
    return taken


def texts(taken: Sequence[Outgoing]) -> list[str]:
    return [f"{outgoing.message.topic}={outgoing.message.payload.decode()}" for outgoing in taken]


def acknowledge(box: Outbox, taken: Sequence[Outgoing]) -> None:
    for outgoing in taken:
        box.acked(outgoing.ticket, 0)
