"""What systemd receives from the service: READY once the lines poll, WATCHDOG only while they do."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.end_to_end.service_manager import UNUSED_PORT, ServiceManager
from tests.end_to_end.site import Program, site_config, write_config


async def test_ready_and_watchdog_come_from_the_lines_work_even_without_a_broker(tmp_path: Path) -> None:
    config = write_config(tmp_path, site_config(broker_port=UNUSED_PORT, port=str(tmp_path / "ttyHALL")))
    manager = ServiceManager(tmp_path / "notify")
    environ = {"NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": "1000000"}
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config), environ=environ) as gateway:
            await manager.receives("READY=1")
            await manager.receives("WATCHDOG=1")
            await manager.receives("WATCHDOG=1")

            gateway.signal(signal.SIGTERM)
            await manager.receives("STOPPING=1")
            code = await gateway.exit_code(within_s=10.0)
    manager.close()

    assert code == 0
