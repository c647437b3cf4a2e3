"""SIGHUP to the service as a process; what a reload changes: `tests/scenarios/broker/test_reload.py`."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.end_to_end.service_manager import UNUSED_PORT, ServiceManager
from tests.end_to_end.site import Program, site_config, write_config
from tests.rig.sites import operator


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
            for text in (good + operator("bob"), good.replace("19200", "7")):
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
