"""First select, then operate."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.starters.policy.start_rules import RuleSet
from tests.starters.fakes import FAULT, READY, VB01
from tests.starters.plant import Plant
from tests.starters.rig import virtually

TWO_STEPS = {"pump-1": RuleSet(two_step=frozenset({"start"}))}


async def plant_with(verb: str = "start", **more: Any) -> tuple[Plant, str]:
    """Return a plant in which alice has selected this command, and her token."""
    plant = await Plant(TWO_STEPS).online()
    plant.submit("select", "s", args={"verb": verb, **more})
    return plant, plant.sink.final("s").values["select"]


@virtually
async def test_a_command_in_two_steps_is_refused_without_the_first() -> None:
    plant = await Plant(TWO_STEPS).online()

    assert await plant.do("start", "1") == "select_first"
    assert await plant.do("start", "2", select="guessed") == "not_selected"
    assert await plant.do("start", "3", starter="pump-2") == "ok"
    assert plant.starts() == 0


@virtually
async def test_a_selection_returns_its_token_and_the_state_that_was_seen() -> None:
    plant, token = await plant_with()

    values = plant.sink.final("s").values
    assert (values["state"], values["valid_s"]) == ("ready", 10.0)
    assert await plant.do("start", "1", select=token) == "ok"
    assert plant.starts() == 1


@virtually
async def test_a_token_serves_once() -> None:
    plant, token = await plant_with()
    await plant.do("start", "1", select=token)
    await plant.do("stop", "2")

    assert await plant.do("start", "3", select=token) == "not_selected"


@virtually
async def test_a_token_serves_for_ten_seconds_only() -> None:
    plant, token = await plant_with()
    await plant.wait(10.0)

    assert await plant.do("start", "1", select=token) == "selection_expired"


@pytest.mark.parametrize(("client", "code"), [("bob", "not_selected"), ("alice", "ok")])
@virtually
async def test_a_token_serves_its_own_client_only(client: str, code: str) -> None:
    plant, token = await plant_with()

    assert await plant.do("start", "1", select=token, client=client) == code


@virtually
async def test_a_token_does_not_serve_once_the_state_has_changed() -> None:
    plant, token = await plant_with("read", args={"parameter": "P003"})
    plant.machines["pump-1"].unit.holding[VB01] = READY | FAULT

    assert await plant.do("read", "1", select=token, args={"parameter": "P003"}) == "state_changed"


@virtually
async def test_a_cancelled_selection_serves_no_more() -> None:
    plant, token = await plant_with()

    assert await plant.do("cancel", "1", client="bob") == "not_selected"
    assert await plant.do("cancel", "2", args={"x": 1}) == "bad_arguments"
    assert await plant.do("cancel", "3") == "ok"
    assert await plant.do("start", "4", select=token) == "not_selected"
    assert await plant.do("cancel", "5") == "not_selected"


@virtually
async def test_a_selected_starter_cannot_be_selected_by_another() -> None:
    plant, _ = await plant_with()

    assert await plant.do("select", "1", client="bob", args={"verb": "start"}) == "selected_by_other"
    await plant.wait(10.0)
    assert await plant.do("select", "2", client="bob", args={"verb": "start"}) == "ok"


@virtually
async def test_a_stop_needs_no_selection_and_asks_for_none() -> None:
    plant, _ = await plant_with()

    assert await plant.do("stop", "0", client="victor") == "ok"
    assert await plant.do("select", "1", args={"verb": "stop"}) == "bad_arguments"


@pytest.mark.parametrize(
    ("args", "client", "code"),
    [
        ({}, "alice", "bad_arguments"),
        ({}, "bob", "not_allowed"),
        ({"verb": "fly"}, "alice", "bad_arguments"),
        ({"verb": "lock"}, "alice", "bad_arguments"),
        ({"verb": "start", "args": []}, "alice", "bad_arguments"),
        ({"verb": "start", "now": 1}, "alice", "bad_arguments"),
        ({"verb": "start", "args": {"x": 1}}, "alice", "bad_arguments"),
        ({"verb": "reset"}, "bob", "not_allowed"),
        ({"verb": "start"}, "victor", "not_allowed"),
        ({"verb": "start"}, "bob", "ok"),  # needs no right of its own
    ],
)
@virtually
async def test_only_what_could_be_commanded_can_be_selected(
    args: dict[str, Any], client: str, code: str
) -> None:
    plant = await Plant(TWO_STEPS).online()

    assert await plant.do("select", "1", args=args, client=client) == code


@virtually
async def test_a_client_without_any_right_cannot_cancel() -> None:
    plant, _ = await plant_with()

    assert await plant.do("cancel", "1", client="mallory") == "not_allowed"


@virtually
async def test_a_starter_whose_state_is_not_known_cannot_be_selected() -> None:
    plant = await Plant(TWO_STEPS).online()
    plant.machines["pump-1"].telemetry.snapshot.mark_stale()

    plant.submit("select", "1", args={"verb": "start"})

    assert plant.sink.final("1").code == "state_unknown"


@virtually
async def test_a_locked_starter_cannot_be_selected() -> None:
    plant = await Plant(TWO_STEPS).online()
    await plant.do("lock", "1", args={"reason": "belt is off"})

    assert await plant.do("select", "2", args={"verb": "start"}) == "locked"


@virtually
async def test_a_repeated_selection_gets_the_same_token_and_a_repeated_start_starts_once() -> None:
    plant, token = await plant_with()
    plant.submit("select", "s", args={"verb": "start"})
    first, second = [r for r in plant.sink.records if getattr(r, "id", None) == "s" and hasattr(r, "values")][
        -2:
    ]
    assert first.values == second.values  # type: ignore[union-attr]  # both are results

    plant.submit("start", "1", select=token)
    plant.submit("start", "1", select=token)
    await asyncio.sleep(3.0)

    assert plant.starts() == 1


@virtually
@pytest.mark.parametrize("client", ["alice", "bob"])
async def test_a_stop_of_any_client_ends_a_selection(client: str) -> None:
    plant, token = await plant_with()
    await plant.do("stop", "1", client=client)

    assert await plant.do("start", "2", select=token) == "not_selected"
    assert plant.starts() == 0
