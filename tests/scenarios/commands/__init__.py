"""What users rely on of commands: what is sent, what reaches the starter, what is answered."""

from __future__ import annotations

from typing import Any

from tests.rig import command
from tests.rig.rows import Action


def do(path: str, **args: Any) -> Action:
    """Send a verb of Alice's with these arguments: `do("pump jog", value=True)`."""
    starter, verb = path.split()
    return command(f"{starter}/alice/{verb}", args=args)


def confirmed(verb: str) -> tuple[str, ...]:
    """Return the results of a command that was carried out."""
    return f"{verb} accepted ok", f"{verb} written ok", f"{verb} confirmed ok"


def refused(verb: str, code: str) -> tuple[str, ...]:
    """Return the results of a command that the readings forbid."""
    return f"{verb} accepted ok", f"{verb} rejected {code}"
