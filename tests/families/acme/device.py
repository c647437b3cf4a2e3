"""Acme Softy: what its notes say that a profile cannot; gateway/families/devices/acme.py if it were real."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gateway.families.devices.device import Device
from gateway.families.devices.findings import Remark, Settings, Topic, Watchdog, Weight, start, unread


class Acme(Device):
    """Softy of all sizes."""

    product = re.compile(r"SOFTY(?![A-Z])")  # 1.5: "SOFTY 30A"
    start_rows = ("T4",)
    watchdog_rows = ("T3",)

    def start_findings(self, settings: Settings) -> Iterator[Remark]:
        """See 4.4."""
        yield from unread(settings, self.start_rows, Topic.START)
        if settings.number("T4") == 0:
            yield start(Weight.ERROR, f"a start is not executed: {settings.shown('T4')}")

    def watchdogs(self, settings: Settings) -> Iterator[Watchdog]:
        """See 4.3."""
        after_s = settings.number("T3")
        if after_s:
            yield Watchdog("T3", after_s / 10, "stops the motor", is_felt=True)


DEVICE = Acme()
