"""Whether the one who answers is the starter that the gateway knows: judged by what it has kept."""

from __future__ import annotations

from pathlib import Path

from gateway.errors import DamagedError
from gateway.families.identify import Identity
from gateway.starters.identities import IDENTITIES_FILE, stranger_in
from gateway.starters.memory import FileMemory
from gateway.starters.setup import StarterSetup


def identity_trouble(state_dir: Path, setup: StarterSetup, identity: Identity) -> str:
    """Return what speaks against this starter; empty when nothing does, or when none was ever seen before."""
    try:
        stranger = stranger_in(FileMemory(state_dir / IDENTITIES_FILE).load() or {}, setup, identity)
    except DamagedError as error:
        return f"whether it is the starter that the gateway knows cannot be told: {error}"
    return "" if stranger is None else stranger.text
