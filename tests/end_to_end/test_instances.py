"""What a second gateway, or another client with its id, may do to the first: nothing that is not said."""

from __future__ import annotations

from pathlib import Path

from tests.end_to_end.plant import plant
from tests.end_to_end.site import Program
from tests.mosquitto import StartMosquitto


async def test_a_second_run_of_a_configuration_ends_at_once_and_leaves_the_first_alone(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, first, config):
        async with Program("gateway", "run", str(config)) as second:
            code = await second.exit_code(within_s=5.0)
        await scada.command("pump", "start", "one")
        await scada.result("pump", verb="start", phase="confirmed")

        assert code == 1
        assert f"another gateway (pid {first.pid}) runs with state_dir" in second.output
        assert second.output.count("\n") == 1
        assert (tmp_path / "state" / "plant.capture").is_socket()
        assert "broker_away" not in {event["code"] for event in scada.events}
