"""The steps of a command, from its arrival to its one end, and which may follow which. Pure.

The published phases follow from the steps: `accepted` with QUEUED, `written` with VERIFYING, a final one with
DONE. What has not reached VERIFYING has written nothing, so that it may be decided again, and be rejected.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping

from gateway.contract import Phase


class CommandStep(enum.Enum):
    """Where a command is."""

    RECEIVED = "received"
    QUEUED = "queued"  # accepted; it waits for a slot on its line, or needs none
    READING = "reading"  # what decides is being read
    DECIDED = "decided"  # two readings in a row lead to the same writes
    WRITING = "writing"  # the first write is handed to the line
    VERIFYING = "verifying"  # something has, or may have, reached the starter
    DONE = "done"


NEXT: Mapping[CommandStep, frozenset[CommandStep]] = {
    CommandStep.RECEIVED: frozenset({CommandStep.QUEUED, CommandStep.DONE}),
    CommandStep.QUEUED: frozenset(
        {CommandStep.READING, CommandStep.VERIFYING, CommandStep.DONE}
    ),  # a stop reads nothing first
    CommandStep.READING: frozenset({CommandStep.DECIDED, CommandStep.DONE}),
    CommandStep.DECIDED: frozenset(
        {CommandStep.WRITING, CommandStep.READING, CommandStep.DONE}
    ),  # what was read may have grown old
    CommandStep.WRITING: frozenset(
        {CommandStep.WRITING, CommandStep.VERIFYING, CommandStep.READING, CommandStep.DONE}
    ),  # it may not have been sent in time; run = 0 may be refused, and the next write is the first
    CommandStep.VERIFYING: frozenset({CommandStep.DONE}),
    CommandStep.DONE: frozenset(),
}

_UNWRITTEN = frozenset({Phase.REJECTED, Phase.FAILED})
ENDS: Mapping[CommandStep, frozenset[Phase]] = {
    CommandStep.RECEIVED: frozenset({Phase.REJECTED}),
    CommandStep.QUEUED: _UNWRITTEN | {Phase.CONFIRMED},  # the gateway's own verbs
    CommandStep.READING: _UNWRITTEN,
    CommandStep.DECIDED: _UNWRITTEN | {Phase.CONFIRMED},  # a read, or a value that the starter held already
    CommandStep.WRITING: _UNWRITTEN,
    CommandStep.VERIFYING: frozenset(
        {Phase.CONFIRMED, Phase.FAILED, Phase.UNCONFIRMED}
    ),  # never "nothing written"
    CommandStep.DONE: frozenset(),
}


class Life:
    """One command's step; one that the tables do not list is a bug and raises ValueError."""

    def __init__(self) -> None:
        self.step = CommandStep.RECEIVED

    @property
    def is_written(self) -> bool:
        """Return whether something has, or may have, reached the starter."""
        return self.step is CommandStep.VERIFYING

    def advance(self, step: CommandStep) -> None:
        """Go on to another step."""
        if step not in NEXT[self.step]:
            raise ValueError(f"a command cannot go from {self.step.value} to {step.value}")
        self.step = step

    def end(self, phase: Phase) -> None:
        """End with a final phase."""
        if phase not in ENDS[self.step]:
            raise ValueError(f"a command that is {self.step.value} cannot end {phase}")
        self.advance(CommandStep.DONE)
