"""The way of a start command, from its message to its result: the files that it goes through.

A whole gateway on the rig, and what is done for the command: in the context of its message, of the tasks that
this begins, and of what they wait for. The sides of line and store are not counted.
"""

from __future__ import annotations

from contextvars import ContextVar
from types import FrameType

from tests.lab.bench.calls import OWN, SITE, Counts, profiled
from tests.rig import RigPlant
from tests.rig.sites import ALICE, QUICK

OTHER_SIDES = (str(OWN / "line"), str(OWN / "store"))
IS_ON_WAY = ContextVar("is_on_way", default=False)


def start_command() -> Counts:
    """Return the calls of a start from its message to its confirmation."""
    counts = Counts()

    def note(frame: FrameType, event: str, value: object) -> None:
        if frame.f_code.co_name == "command_in":  # the message becomes a request
            IS_ON_WAY.set(True)
        if IS_ON_WAY.get() and not frame.f_code.co_filename.startswith(OTHER_SIDES):
            counts.note(frame, event, value)

    with RigPlant(SITE + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=4.0)
        with profiled(note):
            plant.command("pump/alice/start")
            plant.run(until=7.0)
        assert plant.results()[-1] == "start confirmed ok"
    return counts
