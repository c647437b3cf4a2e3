"""What goes along with a starter's telemetry: its readiness, its keypad, and its fast words."""

from __future__ import annotations

from functools import partial

from gateway.clock import Clock
from gateway.starters.fast_lane import FastLane
from gateway.starters.keypad_patrol import EVERY_S, VERBS, KeypadPatrol
from gateway.starters.precautions import Precautions
from gateway.starters.readiness_watch import ReadinessWatch
from gateway.starters.records import AuditRecord, Record, Sink
from gateway.starters.sequence import Sequence
from gateway.starters.telemetry import StarterTelemetry


class Companions:
    """The companions of all starters; also the commander's sink, so that they hear what we set ourselves."""

    def __init__(self, sink: Sink, *, patrol_every_s: float = EVERY_S) -> None:
        self._sink = sink
        self._patrol_every_s = patrol_every_s
        self._starters: list[StarterTelemetry] = []
        self._watches: list[ReadinessWatch] = []
        self._patrols: dict[str, KeypadPatrol] = {}
        self._lanes: list[FastLane] = []

    def add(self, starter: StarterTelemetry) -> None:
        """Go along with this starter."""
        self._starters.append(starter)
        watch = ReadinessWatch(starter)
        starter.when_identified(watch.begin)
        self._watches.append(watch)
        self._patrols[starter.setup.name] = KeypadPatrol(
            starter, on_change=watch.begin, every_s=self._patrol_every_s
        )

    def add_fast_lanes(
        self,
        *,
        precautions: Precautions,
        sink: Sink,
        clock: Clock,
        sequence: Sequence,
        may_write: bool,
    ) -> None:
        """Map the points of those starters added so far for which the configuration wants it."""
        for starter in self._starters:
            if starter.setup.has_fast_words and starter.setup.is_enabled:
                name = starter.setup.name
                lane = FastLane(
                    starter,
                    wear=precautions.wear,
                    sink=sink,
                    clock=clock,
                    sequence=sequence,
                    may_write=may_write,
                    is_locked=partial(_is_locked, precautions, name),
                    on_written=self._patrols[name].note_written,
                )
                starter.when_identified(lane.begin)
                starter.when_fast_words_are_lost(lane.lose)
                self._lanes.append(lane)

    def start(self) -> None:
        """Begin; once, on the app's loop."""
        for patrol in self._patrols.values():
            patrol.start()

    async def close(self) -> None:
        """Do nothing more."""
        for lane in self._lanes:
            await lane.close()
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


def _is_locked(precautions: Precautions, starter: str) -> bool:
    return precautions.logbook.lock_of(starter) is not None
