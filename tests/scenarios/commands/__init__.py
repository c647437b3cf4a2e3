"""What users rely on of commands: what is sent, what reaches the starter, what is answered."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from random import Random
from typing import Any

from gateway.sim.bus.faults import Reply
from tests.rig import RigPlant, command
from tests.rig.rows import Action


class LostWrites:
    """An impairment: writes act, but their answers are lost."""

    def apply(self, reply: Reply, dice: Random) -> tuple[Reply, ...]:
        return () if reply.adu[1] in (5, 6, 15, 16) else (reply,)


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


def issued(ago_s: float, path: str = "pump/alice/start", **fields: object) -> Action:
    """A command with `issued_at` alone, so many seconds before now by the gateway's clock."""

    def act(plant: RigPlant) -> None:
        at = datetime.fromtimestamp(plant.world.utc_s(), UTC) - timedelta(seconds=ago_s)
        plant.command(path, issued_at=at.isoformat(), **fields)

    return act


def old_token(path: str, *, of_s: float, **fields: object) -> Action:
    """A command with the token that was published first after that second."""

    def act(plant: RigPlant) -> None:
        token = plant.messages("gateway/fresh", since=of_s)[0].json["token"]
        plant.command(path, token=token, **fields)

    return act
