"""How a command is judged, remembered and reported, below the scenarios of `tests/scenarios/commands`."""

from __future__ import annotations

import asyncio

from gateway.contract import RecordBus, RecordWriter
from gateway.starters.command.ledger import Ledger
from gateway.starters.command.report import Reporting
from tests.starters.world import MemoryJournal
from tests.virtual_time import VirtualClock


def reporting() -> Reporting:
    """Return a reporting whose records go nowhere, in virtual time."""
    records = RecordWriter(RecordBus(print), VirtualClock(asyncio.get_running_loop()))
    return Reporting(records, Ledger(), MemoryJournal())
