"""What goes along with a starter's telemetry: whether it is ready for remote control, and its keypad."""

from __future__ import annotations

from gateway.starters.keypad_patrol import EVERY_S, VERBS, KeypadPatrol
from gateway.starters.readiness_watch import ReadinessWatch
from gateway.starters.records import AuditRecord, Record, Sink
from gateway.starters.telemetry import StarterTelemetry


class Companions:
    """The companions of all starters; also the commander's sink, so that they hear what we set ourselves."""

    def __init__(self, sink: Sink, *, patrol_every_s: float = EVERY_S) -> None:
        self._sink = sink
        self._patrol_every_s = patrol_every_s
        self._watches: list[ReadinessWatch] = []
        self._patrols: dict[str, KeypadPatrol] = {}

    def add(self, starter: StarterTelemetry) -> None:
        """Go along with this starter."""
        watch = ReadinessWatch(starter)
        starter.when_identified(watch.begin)
        self._watches.append(watch)
        self._patrols[starter.setup.name] = KeypadPatrol(
            starter, on_change=watch.begin, every_s=self._patrol_every_s
        )

    def start(self) -> None:
        """Begin; once, on the app's loop."""
        for patrol in self._patrols.values():
            patrol.start()

    async def close(self) -> None:
        """Do nothing more."""
        for watch in self._watches:
            await watch.close()
        for patrol in self._patrols.values():
            await patrol.close()

    def put(self, record: Record) -> None:
        """Pass a record of the commander on, and remember what it sets."""
        if isinstance(record, AuditRecord) and record.verb in VERBS and record.starter in self._patrols:
            is_over = record.decision not in ("accepted", "written")
            self._patrols[record.starter].note_command(record.verb, record.args, is_over=is_over)
        self._sink.put(record)
