"""Reads that are carried out in several requests, each with a shape of its own; pure."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

from gateway.modbus.pdu import Request

KEPT_S = 1.0  # a part that was read longer ago is read again


@dataclass(slots=True)
class Begun:
    """The parts of one read, and what those asked so far have said."""

    requests: tuple[Request, ...]
    cut: Callable[[Any], Any]
    began_s: float
    values: tuple[Any, ...] = ()
    answered: int = 0

    @property
    def next_request(self) -> Request:
        """The part that is asked next."""
        return self.requests[self.answered]


class Parts:
    """The reads of one line that are under way in parts, by what they are for."""

    def __init__(self) -> None:
        self._begun: dict[Hashable, Begun] = {}

    def begun(self, key: Hashable, now_s: float) -> Begun | None:
        """Return a read that is to be carried on; None when there is none, or its parts are too old."""
        begun = self._begun.get(key)
        return begun if begun is not None and now_s - begun.began_s < KEPT_S else None

    def begin(
        self, key: Hashable, requests: tuple[Request, ...], cut: Callable[[Any], Any], now_s: float
    ) -> None:
        """Read something in these parts."""
        self._begun = {key: each for key, each in self._begun.items() if now_s - each.began_s < KEPT_S}
        self._begun[key] = Begun(requests, cut, now_s)

    def take(self, key: Hashable, value: Any) -> tuple[bool, Any]:
        """Return whether the part that was answered was the last, and then the value of the whole."""
        begun = self._begun[key]
        begun.values += tuple(value)
        begun.answered += 1
        if begun.answered < len(begun.requests):
            return False, None
        del self._begun[key]
        return True, begun.cut(begun.values)

    def drop(self, key: Hashable) -> None:
        """Give up what was read of something."""
        self._begun.pop(key, None)
