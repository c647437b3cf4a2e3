"""The page of a running gateway: its tools, which are processes of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.end_to_end.page.support import PASSWORD, page_table, password_line
from tests.end_to_end.plant import plant
from tests.end_to_end.web.raw_client import WebClient
from tests.mosquitto import StartMosquitto, free_port


async def test_check_doctor_and_diagnostics_of_a_running_gateway_hold_no_secret(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    port, line = free_port(), password_line(PASSWORD)
    async with plant(start_mosquitto(), tmp_path, more=page_table(port, line)) as (_, gateway, _):
        await gateway.says("the status page is served")
        web = WebClient(port)
        assert (await web.log_in("anna", "wrong horse")).status == 401
        assert (await web.log_in("anna", PASSWORD)).status == 200
        web.patience_s = 60.0  # the tools yield to every other process
        check = (await web.post("/api/v1/check")).json
        rows: list[dict[str, Any]] = (await web.get("/api/v1/starter/pump/parameters")).json["rows"]
        diagnostics = await web.get("/api/v1/diagnostics.json")
        journal = gateway.output

    assert check["code"] == 0
    assert "valid, 4 starters" in check["output"]
    named = {row["code"]: row for row in rows}
    assert named["P314"]["writable"]
    assert not named["P003"]["writable"]
    assert line.rpartition("$")[2] not in diagnostics.body.decode()
    assert json.loads(diagnostics.body)["config"]["web"]["user"][0]["password"] == "(left out)"
    assert "web login: user=anna client=alice" in journal
    assert PASSWORD not in journal
