"""How long the way of a page's command is: files and calls from the POST's route to the final answer.

    python -m tests.lab.bench.page_way

One SSW-07 of the rig, in virtual time. `sys.setprofile` counts the calls of functions in `gateway/`, so the
counts are the same on every machine. A lock needs no line: its way is all there is between the request and
its answer. A start takes the line's time besides; what the gateway does meanwhile anyway is subtracted.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import gateway
from tests.rig import RigPlant
from tests.rig.sites import ALICE, LOGIN, QUICK, SSW07, WEB

HOUSE = str(Path(gateway.__file__).parent)
SIMULATOR = f"{HOUSE}/sim/"
CARRIED_OUT_BY = ("/starters/", "/line/", "/families/", "/modbus/", "/storage/", "/system/", "/config/")
RECORDED_BY = ("/history/", "/app/history/", "/plugins/history/", "/app/record_log")
PUBLISHED_BY = ("/mqtt/outbox/", "/mqtt/connection/", "/mqtt/publisher", "/mqtt/message", "/mqtt/leftovers")
OTHERS = CARRIED_OUT_BY + RECORDED_BY + PUBLISHED_BY


def counted(work: Callable[[], Any]) -> Counter[str]:
    """Return the calls by file while something is done."""
    calls: Counter[str] = Counter()

    def note(frame: FrameType, event: str, _: Any) -> None:
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(HOUSE) and not name.startswith(SIMULATOR):
            calls[name.removeprefix(HOUSE)] += 1

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls


def way(verb: str, **fields: Any) -> Counter[str]:
    """Return the way of a command that is confirmed."""
    with RigPlant(SSW07 + ALICE + WEB + LOGIN, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        plant.browser.log_in("anna", "right")
        plant.run(until=6.05)
        answers: list[Any] = []

        def post() -> None:
            body = {"id": "web-1", "token": plant.token(), **fields}
            answers.append(plant.post(f"/api/v1/command/pump/{verb}", body))

        began_s = plant.world.now_s()
        calls = counted(post)
        took_s = plant.world.now_s() - began_s
        assert answers[0].json["phases"][-1]["phase"] == "confirmed", answers[0].text
        if took_s:
            plant.run(until=plant.world.now_s() + 10.0)
            calls -= counted(lambda: plant.run(until=plant.world.now_s() + took_s))
        return calls


def main() -> None:
    """Print the ways; with -v file by file."""
    for what, calls in (("lock", way("lock", args={"reason": "bearing"})), ("start", way("start"))):
        own = {name: count for name, count in calls.items() if not name.startswith(OTHERS)}
        print(f"{what}: {len(calls)} files, {sum(calls.values())} calls; of these in page, contract and app,")
        print(
            f"  without what carries it out, stores and publishes it: {len(own)} files, {sum(own.values())}"
        )
        if "-v" in sys.argv:
            print("\n".join(f"  {count:5d}  {name}" for name, count in calls.most_common()))


if __name__ == "__main__":
    main()
