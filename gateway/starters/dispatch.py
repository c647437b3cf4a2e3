"""Hands what the lines tell to the starters concerned."""

from __future__ import annotations

import logging

from gateway.clock import Clock
from gateway.line.outcome import Outcome
from gateway.starters.publisher import Publisher
from gateway.starters.records import Severity, Sink
from gateway.starters.sequence import Sequence
from gateway.starters.telemetry import StarterTelemetry

logger = logging.getLogger(__name__)


class LineDispatch:
    """Hears of all lines, on the app's loop; implements `gateway.line.listener.LineListener`."""

    def __init__(self, *, sink: Sink, clock: Clock, sequence: Sequence) -> None:
        self._starters: dict[tuple[str, int], StarterTelemetry] = {}
        self._publisher = Publisher("", sink=sink, clock=clock, sequence=sequence)

    def add(self, telemetry: StarterTelemetry) -> None:
        """Hand this starter what concerns it from now on."""
        self._starters[telemetry.setup.line, telemetry.setup.address] = telemetry

    def remove(self, telemetry: StarterTelemetry) -> None:
        """Tell this starter nothing more."""
        self._starters.pop((telemetry.setup.line, telemetry.setup.address), None)

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Hear what became of a poll."""
        starter = self._starters.get((line, unit))
        if starter is not None:
            starter.on_poll(key, outcome)

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that a unit began to answer or went silent."""
        starter = self._starters.get((line, unit))
        if starter is not None:
            starter.on_unit(is_answering=is_answering, reason=reason, frames=frames)

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that a port was opened or is away; without it no starter of its line answers."""
        data = {"line": line, "reason": reason}
        if is_open:
            self._publisher.event("port_open", Severity.INFO, f"line {line}: port open", data)
            return
        self._publisher.event("port_away", Severity.ERROR, f"line {line}: {reason}", data)
        for (its_line, _), starter in self._starters.items():
            if its_line == line:
                starter.on_unit(is_answering=False, reason=reason)
