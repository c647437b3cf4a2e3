"""Which family's words a stop speaks: those that the device proved to be of, else the configured ones.

Only a stop is ever sent to a device that has not proved to be what is configured, and in another family's
words it may do harm: 0100h in VB03 stops an SSW-06 by ramp (ssw06-es 4.2.3), but disables an SSW-07 generally
and sets it to local (ssw07 4.2.2).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import inf

from gateway.contract import Note
from gateway.families import Profile, Variant, diagnosis
from gateway.line import Priority
from gateway.modbus import Request
from gateway.starters.setup import Asked, ask, merged
from gateway.starters.starter import StarterTelemetry
from gateway.starters.state import Snapshot, StarterState


class StopAddressee:
    """A starter as a stop speaks to it: as configured, until the device proves to be of another family."""

    def __init__(self, starter: StarterTelemetry) -> None:
        self._starter, self.name = starter, starter.setup.name
        self._rows = Snapshot(StarterState({}))  # what was read in another family's words: not for publishing

    def note(self, spoken: Collection[str]) -> Note | None:
        """Return what the result says of the words of a stop, sent in those of these families."""
        return diagnosis.stop_note(self._starter.profile, self._starter.standing.identity, spoken)

    @property
    def profile(self) -> Profile:
        """The family that is spoken to."""
        return diagnosis.stop_profile(self._starter.profile, self._starter.standing.identity)

    @property
    def variant(self) -> Variant:
        """What is known of it: of another family only what it said itself."""
        starter = self._starter
        return merged(Variant(), starter.standing.identity) if self.is_other else starter.variant

    @property
    def snapshot(self) -> Snapshot:
        """What was read of it last, by the rows of the family that is spoken to."""
        return self._rows if self.is_other else self._starter.snapshot

    def ask(self, request: Request, *, lane: Priority, until_s: float = inf) -> Asked:
        """Send a request, with the times of the family that is spoken to."""
        setup = replace(self._starter.setup, profile=self.profile)
        return ask(self._starter.line, setup, request, lane=lane, until_s=until_s)

    def take_rows(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        """Keep rows that were just read; those of another family are not published."""
        if self.is_other:
            self._rows.keep_rows(rows, at_s=at_s)
        else:
            self._starter.take_rows(rows, at_s=at_s)

    @property
    def is_other(self) -> bool:
        """Whether that is another family than configured."""
        return self.profile is not self._starter.profile
