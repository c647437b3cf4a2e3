"""The site that is tortured: one line with a starter of each family."""

from __future__ import annotations

from pathlib import Path

from gateway.app.capacity import prospects_of
from gateway.cli.check import gaps_of_starter
from gateway.config.reading import load
from gateway.line.capacity.outage import Gaps, Restart
from tests.rig.sites import ALICE, line, starter, table

STARTERS = {"pump": "ssw07", "fan": "ssw06", "mill": "ssw900", "belt": "sst"}
KEEPALIVE_S = 5


def site(
    folder: Path, broker_port: int, *, deaf_after_s: float, state_dir: Path, mqtt: str, watchdog_s: int = 0
) -> str:
    """Return the configuration of one line with a starter of each family; `mqtt` is the version to speak."""
    url = f"mqtt://127.0.0.1:{broker_port}"
    return (
        table("gateway", name="plant", state_dir=f"{state_dir}", clock="trusted")
        + table("mqtt", version=mqtt, url=url, keepalive_s=KEEPALIVE_S)
        + line("hall", port=f"{folder}/ttyHALL", deaf_after_s=deaf_after_s)
        + "".join(
            starter(name, address, family, watchdog_s=watchdog_s)
            for address, (name, family) in enumerate(STARTERS.items(), 1)
        )
        + ALICE
    )


def computed(config: Path, restart: Restart) -> Gaps:
    """Return the longest gaps of any starter of the only line."""
    (line,) = prospects_of(load(config))
    each = [gaps_of_starter(starter, restart) for starter in line.starters]
    return max(each, key=lambda gaps: gaps.hang_s)
