"""The text of values: nearly all that is published is this, so it is put together by hand."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from gateway.mqtt.json_out import rfc3339, to_json
from gateway.mqtt.topics import Topics, to_level
from gateway.starters.records import ValueRecord


class ValueText(NamedTuple):
    """A value as it is told now, and as it is told later."""

    topic: str
    text: str
    history_topic: str
    item: str  # of the history


class _Names(NamedTuple):
    level: str
    topic: str
    history_topic: str


class ValueTexts:
    """Writes values; remembers the topics of every point there is."""

    def __init__(self, topics: Topics) -> None:
        self._topics = topics
        self._names: dict[tuple[str, str], _Names] = {}

    def of(self, record: ValueRecord) -> ValueText:
        """Return a value's texts; ValueError when the starter's name is no topic level."""
        names = self._names.get((record.starter, record.point))
        if names is None:
            names = self._names_of(record.starter, record.point)
        value = to_json(record.value)
        fate = f'"quality":"{record.quality}","time":{_quoted(record.time_s)},"seq":{record.seq}'
        label = "" if record.label is None else f',"label":{to_json(record.label)}'
        reason = f',"reason":{to_json(record.reason)}' if record.reason else ""
        text = f'{{"value":{value},"unit":{to_json(record.unit)},{fate}{label}{reason}}}'
        item = f'{{"point":"{names.level}","value":{value},{fate}}}'
        return ValueText(names.topic, text, names.history_topic, item)

    def _names_of(self, starter: str, point: str) -> _Names:
        level = to_level(point)
        names = _Names(level, self._topics.value(starter, level), self._topics.history(starter))
        self._names[starter, point] = names
        return names


@lru_cache(maxsize=64)  # the points of one reply have one time
def _quoted(time_s: float | None) -> str:
    return to_json(rfc3339(time_s))
