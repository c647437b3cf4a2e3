"""SIGHUP to the service with real processes: what is the same goes on, what differs is changed, no more."""

from __future__ import annotations

import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.end_to_end.plant import STARTERS
from tests.end_to_end.service_manager import UNUSED_PORT, ServiceManager
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.lab.torture.starters import StartersProcess
from tests.mosquitto import MosquittoBroker, StartMosquitto

RIGHTS = '\n[[operator]]\nclient = "bob"\nmay = ["read"]\nstarters = ["pump"]\n'
WATCHDOG_S = 4  # in every starter; it only says that it would have acted
REGULAR_S, BOUND_S = 1.0, 1.0  # the longest gap computed for this line, and what a busy machine may add


class Hup:
    """A gateway whose configuration changes."""

    def __init__(self, gateway: Program, config: Path, scada: Scada) -> None:
        self.good = config.read_text("utf-8")
        self._gateway, self._config, self._scada = gateway, config, scada

    async def reload(self, text: str, *, code: str = "reloaded") -> dict[str, Any]:
        """Have this read and return the event that reports what came of it."""
        self._scada.latest.pop("gateway/event", None)
        self._config.write_text(text, "utf-8")
        self._gateway.signal(signal.SIGHUP)
        return await self._scada.until("gateway/event", code=code)


@asynccontextmanager
async def watched_plant(
    broker: MosquittoBroker, folder: Path
) -> AsyncIterator[tuple[Hup, StartersProcess, Scada]]:
    """Run the gateway on starters in a process of their own, which record how long they had to wait."""
    text = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"))
    config = write_config(folder, text.replace("adapter_allowance_s = 0.3\n", ""))  # no watchdog could be met
    starters = StartersProcess(config, WATCHDOG_S)
    await starters.start()
    try:
        async with (
            Scada(broker.port) as scada,
            Program("gateway", "run", str(config)) as gateway,
        ):
            for name in STARTERS:
                await scada.until(f"starter/{name}/state", state="ready", quality="good")
            await starters.order("mark")
            yield Hup(gateway, config, scada), starters, scada
    finally:
        await starters.stop()


def longest_gap_s(report: dict[str, Any], *names: str) -> float:
    return max(to_s - from_s for name in names for from_s, to_s in report["starters"][name]["gaps"])


@pytest.mark.alone
async def test_no_watchdog_acts_on_reloads_nor_while_a_line_is_opened_again(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with watched_plant(start_mosquitto(), tmp_path) as (hup, starters, scada):
        without_belt = hup.good.replace("address = 4", "address = 4\nenabled = false")
        for text in (hup.good + RIGHTS, hup.good.replace("every_s = 0.2", "every_s = 0.3"), without_belt):
            await hup.reload(text)
            await hup.reload(hup.good)
            await hup.reload(hup.good.replace("19200", "7"), code="reload_refused")
        polled = await starters.order("report")
        reopened = await hup.reload(
            hup.good.replace('framing = "8N2"', 'framing = "8N2"\ndeaf_after_s = 20.0')
        )
        await scada.until("gateway/event", code="port_open")
        for name in STARTERS:
            await scada.until(f"starter/{name}/state", state="ready", quality="good")
        report = await starters.order("report")
        written = [await starters.order("written", starter=name, since_s=0.0) for name in STARTERS]

    assert reopened["data"]["lines_reopened"] == ["hall"]
    assert [each["trips"] for each in report["starters"].values()] == [[], [], [], []]
    assert longest_gap_s(polled, "pump", "fan", "mill") < REGULAR_S + BOUND_S
    assert longest_gap_s(report, "pump", "fan", "mill") < 2 * REGULAR_S + BOUND_S
    assert [each["writes"] for each in written] == [[], [], [], []]


async def test_systemd_is_notified_of_the_begin_and_the_end_of_a_reload_good_or_bad(
    tmp_path: Path,
) -> None:
    config = write_config(tmp_path, site_config(broker_port=UNUSED_PORT, port=str(tmp_path / "ttyHALL")))
    manager = ServiceManager(tmp_path / "notify")
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall")
        async with Program(
            "gateway", "run", str(config), environ={"NOTIFY_SOCKET": manager.address}
        ) as gateway:
            await manager.receives("READY=1")
            good = config.read_text("utf-8")
            for text in (good + RIGHTS, good.replace("19200", "7")):
                config.write_text(text, "utf-8")
                gateway.signal(signal.SIGHUP)
                await manager.receives("RELOADING=1")
                await manager.receives("READY=1")
            await gateway.says("reload refused")
            gateway.signal(signal.SIGHUP)
            gateway.signal(signal.SIGTERM)  # in the middle of it
            code = await gateway.exit_code(within_s=10.0)
    manager.close()

    assert code == 0
    assert "Traceback" not in gateway.output
