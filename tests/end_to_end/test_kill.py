"""What SIGKILL leaves behind."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from gateway.storage.database import Database
from gateway.storage.ledger_table import LedgerTable
from tests.end_to_end.killed_writer import write_until_killed
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import StartMosquitto

KILLS = 20
LONGEST_S = 0.15


def rows_of(path: Path) -> list[str]:
    """Return the ids in the ledger; it must have opened without putting anything aside."""
    table = LedgerTable()
    database = Database(path, [table], 2**26)
    assert database.open() == ""
    (rows,) = database.transact([table.rows])
    database.close()
    return [row.id for row in rows]


def test_no_acknowledged_row_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(20)
    path = tmp_path / "x.sqlite"
    acknowledged: list[str] = []
    for kill in range(KILLS):
        acknowledged += write_until_killed("ledger_writer", path, kill, dice, LONGEST_S)

        stored = rows_of(path)

        assert len(stored) == len(set(stored))
        assert set(acknowledged) <= set(stored)
    assert len(acknowledged) > 20 * KILLS


@pytest.mark.long
async def test_a_start_that_a_kill_cut_short_is_reported_once_and_never_repeated(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    config = write_config(tmp_path, site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL")))
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        broker.watch("starters/plant/#") as w,
    ):
        await simulator.says("line hall")
        scada = Scada(broker, w)
        async with Program("gateway", "run", str(config)) as gateway:
            for starter in ("pump", "fan", "mill", "belt"):
                await scada.ready(starter)
            await scada.command("pump", "start", "cut")
            await scada.result("pump", id="cut", phase="written")
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()
        await scada.until("gateway/status", state="offline")
        async with Program("gateway", "run", str(config)) as gateway:
            result = await scada.result("pump", id="cut", phase="unconfirmed")
            await scada.until("starter/pump/state", state="running", quality="good")
            await scada.publish("command/pump/alice/stop", "")
            await scada.until("starter/pump/state", state="ready", quality="good")
            await scada.command("pump", "start", "cut")
            again = await scada.result("pump", id="cut", duplicate=True)
            await scada.command("pump", "read", "after", parameter="P003")
            await scada.result("pump", id="after", phase="confirmed")

    assert result["code"] == "crashed"
    assert result["state"] in ("starting", "running")
    assert (again["phase"], again["code"]) == ("unconfirmed", "crashed")
    assert scada.latest["starter/pump/state"]["state"] == "ready"
    assert [result["duplicate"] for result in scada.results if result["code"] == "crashed"] == [False, True]
