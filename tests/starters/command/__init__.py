"""How a command is judged, remembered and reported, below the scenarios of `tests/scenarios/commands`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gateway.contract import RecordBus, RecordWriter, ResultRecord
from gateway.starters.command.ledger import Ledger
from gateway.starters.command.report import Reporting
from gateway.store import Journal
from tests.virtual_time import VirtualClock


class NoJournal(Journal):
    """Keeps nothing."""

    trouble = ""

    def __init__(self) -> None: ...

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        if then is not None:
            then()


def reporting() -> Reporting:
    """Return a reporting whose records go nowhere, in virtual time."""
    records = RecordWriter(RecordBus(print), VirtualClock(asyncio.get_running_loop()))
    return Reporting(records, Ledger(), NoJournal())
