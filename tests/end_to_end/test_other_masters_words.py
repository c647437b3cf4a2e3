"""The gateway against a Modbus server that shares no code with it."""

from __future__ import annotations

from pathlib import Path

from tests.end_to_end.pty_pair import PtyPair
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import StartMosquitto
from tests.rig.sites import starter

STARTER = starter("pump", 7, "ssw07", every_s=0.2)
# ready, general enabled, remote, supplied; P001-P003; P014; all other registers of the family
WORDS = dict.fromkeys((5, 6, 7, 11, 14, 30, 31, 32, 50, 81), 0) | {
    1: 300,
    2: 500,
    3: 400,
    5001: 0x4102,
}


async def test_the_values_of_another_projects_server_are_published_as_they_are(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    cells = [f"{address}={word}" for address, word in sorted(WORDS.items())]
    with PtyPair() as pair:
        text = site_config(broker_port=broker.port, port=pair.left, starters=STARTER, framing="8E1")
        config = write_config(tmp_path, text)
        async with (
            Program("tests.end_to_end.pymodbus_server", pair.right, "19200", "7", *cells) as serving,
            broker.watch("starters/plant/#") as watcher,
        ):
            await serving.says("serving")
            async with Program("gateway", "run", str(config)):
                scada = Scada(broker, watcher)

                state = await scada.until("starter/pump/state", quality="good")
                current = await scada.until("starter/pump/value/current", quality="good")
                current_pct = await scada.until("starter/pump/value/current_pct", quality="good")

    assert state["state"] == "ready"
    assert (current["value"], current["unit"]) == (40.0, "A")
    assert (current_pct["value"], current_pct["unit"]) == (50.0, "%")
