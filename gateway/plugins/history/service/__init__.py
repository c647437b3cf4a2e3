"""The motors' history while the gateway runs: feeds `gateway.plugins.history`, stores what it gives.

Start reading at `service.py`; each kind of history (starts, trips, counters) is a part of its own.
"""

from gateway.plugins.history.service.service import HistoryService

__all__ = ["HistoryService"]
