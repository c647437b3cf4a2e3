"""The page of a running gateway: its tools, which are processes of their own, and the journal."""

from __future__ import annotations

from pathlib import Path

from tests.end_to_end.page.support import PASSWORD, page_table, password_line
from tests.end_to_end.plant import plant
from tests.end_to_end.web.raw_client import WebClient
from tests.mosquitto import StartMosquitto, free_port


async def test_check_runs_beside_the_gateway_and_no_password_is_in_its_journal(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    port = free_port()
    table = page_table(port, password_line(PASSWORD))
    async with plant(start_mosquitto(), tmp_path, more=table) as (_, gateway, _):
        await gateway.says("the status page is served")
        web = WebClient(port)
        assert (await web.log_in("anna", "wrong horse")).status == 401
        assert (await web.log_in("anna", PASSWORD)).status == 200
        web.patience_s = 60.0  # the tools yield to every other process
        check = (await web.post("/api/v1/check")).json
        journal = gateway.output

    assert check["code"] == 0
    assert "valid, 4 starters" in check["output"]
    assert "web login: user=anna client=alice" in journal
    assert PASSWORD not in journal
