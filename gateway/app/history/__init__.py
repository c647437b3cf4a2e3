"""The motors' history while the gateway runs: feeds `gateway.history`, stores what it gives.

Start reading at `service.py`; each kind of history (starts, trips, counters) is a part of its own.
"""

from gateway.app.history.service import HistoryService

__all__ = ["HistoryService"]
