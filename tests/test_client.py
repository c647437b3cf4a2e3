"""The client for integrators, at a whole gateway in virtual time; at a real broker: the tutorial's `send`."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from gateway.client import Client
from gateway.contract import ResultRecord
from gateway.errors import NoResultError, UsageError
from tests.rig import RigPlant
from tests.rig.sites import ALICE, QUICK, SSW07, table

TWO_STEPS = table("[rules]", starters=["pump"], two_step=["start"])
ALICES = Client("mqtt://127.0.0.1", base="starters/plant", client="alice", operator="Alice A.")


@pytest.fixture
def plant() -> Iterator[RigPlant]:
    with RigPlant(SSW07 + ALICE + TWO_STEPS, sim={"pump": QUICK}) as plant:
        plant.run(until=4.0)
        yield plant


def start(plant: RigPlant, **options: object) -> ResultRecord:
    """Select a start and carry it out."""
    selected = plant.await_(ALICES.command("pump", "select", {"verb": "start"}))
    return plant.await_(ALICES.command("pump", "start", select=selected.values["select"], **options))


def test_a_command_is_fresh_and_followed_to_its_end(plant: RigPlant) -> None:
    phases: list[ResultRecord] = []

    result = start(plant, reason="as agreed", expect={"state": "ready"}, ttl_s=3.0, on_phase=phases.append)

    sent = plant.last("command/pump/alice/start")
    assert sent.pop("issued_at").endswith("Z")
    assert sent.pop("id") == result.id
    assert sent.pop("boot") == plant.last("gateway/status")["boot"]
    assert sent.keys() == {"token", "operator", "reason", "ttl_s", "expect", "select"}
    assert (sent["operator"], sent["reason"], sent["ttl_s"]) == ("Alice A.", "as agreed", 3.0)
    assert [phase.phase for phase in phases] == ["accepted", "written"]
    assert phases[1].may_have_acted
    assert (result.is_confirmed, result.may_have_acted, result.is_duplicate) == (True, False, False)
    assert result.what_to_do == "Nothing."
    assert plant.await_(ALICES.read("pump", "P314")).values["unit"] == "s"


def test_a_command_sent_again_by_its_id_gets_the_stored_result(plant: RigPlant) -> None:
    with pytest.raises(NoResultError) as unknown:
        start(plant, within_s=0.01)
    plant.run(until=10.0)

    again = plant.await_(ALICES.command("pump", "start", id_=unknown.value.id))

    assert "look at the starter" in str(unknown.value)
    assert (again.id, again.is_duplicate, again.is_confirmed) == (unknown.value.id, True, True)
    assert len(plant.starter("pump").unit.start_frames) == 1


def test_a_connection_lost_after_the_command_leaves_its_end_unknown(plant: RigPlant) -> None:
    async def lost() -> None:
        asking = asyncio.create_task(ALICES.stop("pump"))
        while not plant.messages("command/pump/alice/stop"):  # noqa: ASYNC110 - of the broker
            await asyncio.sleep(0.001)
        plant.broker.drop("alice-*")
        await asking

    with pytest.raises(NoResultError, match="was lost before the final result") as unknown:
        plant.await_(lost())

    assert unknown.value.id == plant.last("command/pump/alice/stop")["id"]


@pytest.mark.parametrize(
    ("url", "base", "name"),
    [
        ("http://broker", "starters/mcc1", "alice"),
        ("mqtt://", "starters/mcc1", "alice"),
        ("mqtt://broker", "starters/mcc1", "Alice"),
        ("mqtt://broker", "acme//mcc1", "alice"),
        ("mqtt://broker", "acme/+/mcc1", "alice"),
    ],
)
def test_an_unfit_url_base_or_client_is_refused_at_once(url: str, base: str, name: str) -> None:
    with pytest.raises(UsageError):
        Client(url, base=base, client=name)
