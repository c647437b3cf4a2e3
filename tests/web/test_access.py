"""What the page gets of the gateway: stored starts with their samples, why not, and no secret."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.app.page.access import MOST_STARTS, WebAccess
from gateway.app.site import Site
from gateway.config.load import parse
from gateway.errors import StoreError
from gateway.mqtt.contract.freshness import RunToken, Tokens
from gateway.storage.history_table import HistoryRow
from gateway.system.password_hash import password_line
from tests.config.sites import SITE
from tests.starters.plant import Plant
from tests.starters.rig import virtually

LINE = password_line("correct horse", salt=b"0123456789abcdef")
USER = f'[web]\n[[web.user]]\nname = "anna"\npassword = "{LINE}"\noperator = "alice"\n'


def access(
    plant: Plant,
    rows: Sequence[HistoryRow] | StoreError = (),
    *,
    progress: Callable[[], dict[str, int]] = dict,
) -> tuple[WebAccess, list[Any]]:
    taken: list[Any] = []

    async def stored(starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
        if isinstance(rows, StoreError):
            raise rows
        return [row for row in rows if row.starter == starter and row.kind in kinds]

    made = WebAccess(
        site=Site(parse(SITE + USER, "site.toml"), Path("/etc"), None, ()),
        tokens=Tokens(RunToken("boot")),
        take=taken.append,
        dispatcher=plant.dispatcher,
        policy=plant.policy,
        starters={name: machine.telemetry for name, machine in plant.machines.items()},
        clock_doubt=lambda: None,
        is_connected=lambda: True,
        progress=progress,
        metrics_service=SimpleNamespace(service=None),  # type: ignore[arg-type]
        stored=stored,
        writer=plant.records,
    )
    return made, taken


@virtually
async def test_the_token_is_renewed_each_second_and_at_once_when_the_old_one_counts_no_more() -> None:
    plant = await Plant().online()
    web, _ = access(plant)

    first = web.token()
    assert web.token() == first
    web.tokens.boot.stood_still(plant.clock.now_s())
    second = web.token()
    await asyncio.sleep(1.1)

    assert len({first, second, web.token()}) == 3


@virtually
async def test_the_token_is_renewed_at_once_when_a_stop_has_come() -> None:
    plant = await Plant().online()
    web, _ = access(plant)
    before = web.token()
    await asyncio.sleep(0.1)

    plant.submit("stop", "1", starter="pump-2")

    after = web.token()
    assert after != before
    assert web.tokens.made_s(after) == plant.clock.now_s()
    await asyncio.sleep(0.1)
    assert web.token() == after
    await plant.wait(3.0)


@virtually
async def test_stored_starts_have_their_samples_and_the_newest_stand_last() -> None:
    plant = await Plant().online()
    rows = [
        HistoryRow("pump-1", "start", f"s{n}", float(n), {"id": f"s{n}"}, 250) for n in range(MOST_STARTS + 9)
    ]
    rows += [HistoryRow("pump-1", "curve", "s3", 3.0, {"t_s": [0.0]}, 20)]
    rows += [HistoryRow("pump-1", "trip", "t1", 3.0, {"id": "t1"}, 100)]
    web, _ = access(plant, rows)

    records = await web.records("pump-1")

    assert records is not None
    assert records["starts"][0] == {"id": "s3", "samples": {"t_s": [0.0]}}
    assert len(records["starts"]) == MOST_STARTS + 1
    assert records["starts"][-1]["id"] == f"s{MOST_STARTS + 8}"
    assert records["trips"] == [{"id": "t1"}]
    away, _ = access(plant, StoreError("no disk"))
    assert await away.records("pump-1") is None


@pytest.mark.parametrize("family", ["ssw06", "ssw07", "ssw900", "sst"])
def test_each_familys_rows_say_what_they_may_be_set_to(family: str) -> None:
    from gateway.app.page.parameters import rows_of, sample_args
    from gateway.families.profile.load import load_profile
    from gateway.families.profile.schema import Variant

    rows = list(rows_of(load_profile(family), Variant()))

    assert len(rows) > 20
    assert any(row["writable"] for row in rows)
    assert all(row["writable"] or row["why_not"] for row in rows)
    assert sample_args(family, "read")
    assert sample_args(family, "set")


@virtually
async def test_lines_that_move_are_well_and_the_first_that_does_not_is_named() -> None:
    plant = await Plant().online()
    steps = {"pumps": 5, "fans": 7}
    web, _ = access(plant, progress=lambda: dict(steps))

    async def move() -> None:
        while True:
            await asyncio.sleep(1.0)  # as a line that has nothing to ask
            steps["pumps"] += 1

    moving = asyncio.create_task(move())
    stuck = await web.health()
    steps.pop("fans")
    well = await web.health()
    moving.cancel()

    assert stuck == {"lines": {"pumps": True, "fans": False}, "broker": True}
    assert well == {"lines": {"pumps": True}, "broker": True}
