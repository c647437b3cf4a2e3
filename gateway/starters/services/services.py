"""What goes along with each starter, beside its polls."""

from __future__ import annotations

from gateway.starters.services.past_reader import PastListener, PastReader
from gateway.starters.services.settings import EVERY_S, SettingsWatch
from gateway.starters.starter import StarterTelemetry


def serve(
    starter: StarterTelemetry, past: PastListener | None = None, *, monitor_every_s: float = EVERY_S
) -> None:
    """Have a starter's settings watched, and what it says of its past read where somebody listens."""
    starter.services.append(SettingsWatch(starter, every_s=monitor_every_s))
    if past is not None:
        starter.services.append(PastReader(starter, past))
