"""Hands what happens on a line to its starters, as the plant does."""

from __future__ import annotations

from collections.abc import Callable

from gateway.line.events import LineEvent, LineFault, PollResult, PortChanged, UnitChanged
from gateway.starters import StarterTelemetry


class Router:
    """`handle` takes the events of one line."""

    def __init__(self, on_fault: Callable[[str], None] = lambda _: None) -> None:
        self.starters: dict[int, StarterTelemetry] = {}
        self._on_fault = on_fault  # takes the codes of the line's faults

    def add(self, starter: StarterTelemetry) -> None:
        self.starters[starter.setup.address] = starter

    def handle(self, event: LineEvent) -> None:
        match event:
            case PollResult():
                self.starters[event.unit].on_poll(event.key, event.outcome)
            case UnitChanged():
                self.starters[event.unit].on_unit(
                    is_answering=event.is_answering, reason=event.reason, frames=event.frames
                )
            case LineFault():
                self._on_fault(event.code)
            case PortChanged(is_open=False):
                for starter in self.starters.values():
                    starter.on_unit(is_answering=False, reason=event.reason)
