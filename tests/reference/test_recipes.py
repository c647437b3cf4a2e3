"""What docs/recipes.md says to send is what the gateway takes."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.contract import STOP, CommandRequest, Topics
from gateway.mqtt.commands import Incoming, command_in
from gateway.starters import Tokens
from gateway.starters.policy.freshness import ArrivalTime, dated
from tests.reference.examples import ROOT, blocks

NOW, NOW_S = "2026-11-21T01:02:03Z", 1_795_222_923.0
TOKENS = Tokens("boot-1")
TOKEN = TOKENS.issue(7.0)  # when everything arrives
BASE = "starters/mcc1"


def request(topic: str, payload: str) -> CommandRequest:
    """Return the command that a message is; it is fresh, or needs not be."""
    address = Topics(BASE).parse_command(topic)
    assert address is not None
    received = command_in(address, Incoming(topic, payload.encode()), 7.0, verb_error=lambda *_: None)
    assert received.refusal is None, received
    judged = received.request
    if judged.verb != STOP:
        moment = ArrivalTime(7.0, NOW_S)
        dated(judged, freshness=("token",), tokens=TOKENS, moment=moment)
    return judged


@pytest.mark.parametrize("payload", blocks("recipes.md", "json"))
def test_each_start_of_the_page_is_taken_as_fresh(payload: str) -> None:
    filled = payload.replace("TOKEN", TOKEN).replace("NOW", NOW)

    taken = request(f"{BASE}/command/pump-1/alice/start", filled)

    assert taken.id == json.loads(payload)["id"]


def test_the_page_shows_every_way_and_no_id_twice() -> None:
    bodies = [json.loads(payload) for payload in blocks("recipes.md", "json")]

    assert {"token", "issued_at"} <= {name for body in bodies for name in body}
    assert len({body["id"] for body in bodies}) == len(bodies)


@pytest.mark.parametrize("verb", ["start", "stop"])
def test_what_the_script_for_ignition_publishes_is_taken(verb: str) -> None:
    sent: list[tuple[Any, ...]] = []
    read = {f"[MQTT Engine]{BASE}/gateway/fresh/token": TOKEN}
    system = SimpleNamespace(
        tag=SimpleNamespace(readBlocking=lambda tags: [SimpleNamespace(value=read[tag]) for tag in tags]),
        util=SimpleNamespace(jsonEncode=json.dumps),
        cirruslink=SimpleNamespace(engine=SimpleNamespace(publish=lambda *given: sent.append(given))),
    )
    scope: dict[str, Any] = {"system": system}
    (script,) = blocks("recipes.md", "python")
    exec(script, scope)

    ids = [scope["command"]("pump-1", verb) for _ in range(2)]

    assert ids[0] != ids[1]
    for id_, (server, topic, payload, qos, retained) in zip(ids, sent, strict=True):
        assert (server, qos, retained) == ("plant", 1, False)
        taken = request(topic, payload.decode())
        assert (taken.starter, taken.client, taken.verb, taken.id) == ("pump-1", "ignition", verb, id_)


def test_what_the_script_for_wincc_oa_sets_is_taken() -> None:
    (script,) = blocks("recipes.md", "c")
    (expression,) = re.findall(r'dpSet\(pump \+ "\.command\.start", (.*)\);', script)

    payload = eval(expression, {"createUuid": lambda: "an-id", "token": TOKEN})  # texts of C are Python's

    assert request(f"{BASE}/command/pump-1/winccoa/start", payload).id == "an-id"


def test_the_flow_for_node_red_is_still_a_flow_with_the_sites_names_put_in() -> None:
    (script,) = blocks("recipes.md", "sh")
    command = script.partition(" > ")[0]

    done = subprocess.run(shlex.split(command), cwd=ROOT, capture_output=True, text=True, check=True)

    assert json.loads(done.stdout)
    assert "acme/site1/mcc1/command/pump-7/alice/start" in done.stdout
    assert not re.search(r"starters/mcc1/|pump-1\b|127\.0\.0\.1", done.stdout)
