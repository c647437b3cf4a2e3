"""A stop's frame waits for no disk, whatever state that is in; and what is stored there is private."""

from __future__ import annotations

import re
import resource
from datetime import datetime
from pathlib import Path

import pytest

from tests.end_to_end.plant import plant
from tests.mosquitto import StartMosquitto

pytestmark = pytest.mark.alone

STOPS = 5
WITHIN_S = 0.3  # of the publishing program's start; on a quiet machine a tenth of that
STOP_FRAME = re.compile(r"^(\S+ \S+),(\d+) .*line=hall .*>> 01 05 00 64 00 00", re.MULTILINE)


async def test_a_stop_goes_out_at_once_on_a_disk_that_fails_and_files_are_private(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path, options=("-v",)) as (scada, gateway, _):
        await scada.command("pump", "start", "up")
        await scada.result("pump", id="up", phase="confirmed")
        assert {
            path.stat().st_mode & 0o077 for path in (tmp_path / "state").rglob("*") if path.is_file()
        } == {0}

        resource.prlimit(gateway.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        waits_s = []
        for number in range(STOPS):
            before = len(gateway.output)
            began_s = datetime.now().astimezone().timestamp()
            scada.say("command/pump/alice/stop", {"id": f"{number}"})
            await scada.result("pump", id=f"{number}", phase="confirmed")
            found = STOP_FRAME.search(gateway.output, before)
            assert found is not None
            at_s = (
                datetime.strptime(found[1], "%Y-%m-%d %H:%M:%S").astimezone().timestamp()
                + int(found[2]) / 1000
            )
            waits_s.append(at_s - began_s)

        assert "only stop is accepted" in gateway.output
        assert max(waits_s) <= WITHIN_S
