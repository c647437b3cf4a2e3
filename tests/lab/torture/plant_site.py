"""The site that is tortured: one line with a starter of each family."""

from __future__ import annotations

from pathlib import Path

from gateway.app.capacity import prospects_of
from gateway.cli.check import gaps_of_starter
from gateway.config.load import load
from gateway.line.capacity.outage import Gaps, Restart

STARTERS = {"pump": "ssw07", "fan": "ssw06", "mill": "ssw900", "belt": "sst"}
KEEPALIVE_S = 5


def site(
    folder: Path, broker_port: int, *, deaf_after_s: float, state_dir: Path, mqtt: str, watchdog_s: int = 0
) -> str:
    """Return the configuration of one line with a starter of each family; `mqtt` is the version to speak."""
    starters = "".join(
        f'\n[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\nevery_s = 1.0\n'
        f"watchdog_s = {watchdog_s}\n"
        for address, (name, family) in enumerate(STARTERS.items(), 1)
    )
    return (
        f'[gateway]\nname = "plant"\nstate_dir = "{state_dir}"\nclock = "trusted"\n\n'
        f'[mqtt]\nversion = "{mqtt}"\nurl = "mqtt://127.0.0.1:{broker_port}"\nkeepalive_s = {KEEPALIVE_S}\n\n'
        f'[[line]]\nname = "hall"\nport = "{folder}/ttyHALL"\nbaud = 19200\nframing = "8N2"\n'
        f"deaf_after_s = {deaf_after_s}\n{starters}"
        '\n[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n'
    )


def computed(config: Path, restart: Restart) -> Gaps:
    """Return the longest gaps of any starter of the only line."""
    (line,) = prospects_of(load(config))
    each = [gaps_of_starter(starter, restart) for starter in line.starters]
    return max(each, key=lambda gaps: gaps.hang_s)
