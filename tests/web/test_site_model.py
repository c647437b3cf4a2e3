"""What the page knows: the newest of each topic, and what is newer than a client has seen."""

from __future__ import annotations

import random

from gateway.records import AuditRecord, Phase, ResultRecord
from gateway.web.site_model import MOST_COMMANDS, MOST_MESSAGES, MOST_RECORD_BYTES, SiteModel
from tests.web.support import shown_site

BASE = "starters/mcc1"


def model(**groups: tuple[str, ...]) -> SiteModel:
    return SiteModel(shown_site(groups=groups))


def retain(site: SiteModel, name: str, payload: bytes) -> None:
    site.publish(f"{BASE}/{name}", payload, is_retained=True)


def happen(site: SiteModel, name: str, payload: bytes = b"{}") -> None:
    site.publish(f"{BASE}/{name}", payload, is_retained=False)


def test_the_overview_has_states_alarms_and_currents_and_a_scope_all_of_its_starter() -> None:
    site = model()
    for starter in ("pump-1", "pump-2"):
        for each in ("state", "availability", "info", "alarm/e05", "value/current", "value/p002"):
            retain(site, f"starter/{starter}/{each}", b'{"n":1}')
    retain(site, "gateway/status", b"{}")

    overview, scoped = dict(site.topics(None)), dict(site.topics("pump-1"))

    assert "starter/pump-1/value/current" in overview
    assert "starter/pump-1/alarm/e05" in overview
    assert "gateway/status" in overview
    assert not {"starter/pump-1/value/p002", "starter/pump-1/info"} & overview.keys()
    assert scoped.keys() - overview.keys() == {"starter/pump-1/value/p002", "starter/pump-1/info"}


def test_payloads_are_the_very_bytes_that_mqtt_gets() -> None:
    site, payload = model(), b'{"value":12.0,  "odd" : true}'

    retain(site, "starter/pump-1/value/current", payload)

    assert dict(site.topics(None))["starter/pump-1/value/current"] is payload


def test_a_client_that_follows_the_changes_always_has_what_the_whole_would_be() -> None:
    chance = random.Random(7)
    names = [f"starter/pump-{n}/value/{p}" for n in (1, 2) for p in ("current", "current_pct")]
    site, seen, gen = model(), {}, 0
    for _ in range(300):
        for _ in range(chance.randrange(4)):
            name = chance.choice(names)
            retain(site, name, b"" if chance.random() < 0.2 else b"%d" % chance.randrange(99))
        for name, payload in site.topics(None, gen):
            if payload is None:
                seen.pop(name, None)
            else:
                seen[name] = payload
        gen = site.gen

        assert seen == dict(site.topics(None))


def test_a_branch_that_is_cleared_goes_with_all_its_topics() -> None:
    site = model()
    retain(site, "starter/pump-1/state", b"{}")
    retain(site, "starter/pump-10/state", b"{}")
    gen = site.gen

    retain(site, "starter/pump-1", b"")

    assert dict(site.topics(None, gen)) == {"starter/pump-1/state": None}
    assert dict(site.topics(None)) == {"starter/pump-10/state": b"{}"}


def test_messages_are_sent_once_and_in_order_and_missed_ones_are_noticed() -> None:
    site = model()
    happen(site, "gateway/event", b"1")
    gen = site.gen
    happen(site, "audit", b"2")
    happen(site, "result/pump-1/alice", b"3")

    assert [each.payload for each in site.messages(None, gen) or ()] == [b"2", b"3"]
    for n in range(MOST_MESSAGES + 1):
        happen(site, "gateway/event", b"%d" % n)
    assert site.messages(None, gen) is None
    assert len(site.messages(None) or ()) == MOST_MESSAGES


def test_results_stand_in_the_whole_only_of_the_starter_in_scope() -> None:
    site = model()
    happen(site, "result/pump-1/alice", b"1")
    happen(site, "result/pump-2/alice", b"2")

    assert [each.payload for each in site.messages("pump-2") or ()] == [b"2"]
    assert site.messages(None) == []


def test_a_command_has_its_phases_and_arguments_and_a_starter_its_last_twenty() -> None:
    site = model()
    for n in range(MOST_COMMANDS + 5):
        result = ResultRecord("pump-1", "alice", str(n), "set", Phase.ACCEPTED, "ok", "accepted", 1.0)
        site.put(result, 0.0)
        site.put(
            AuditRecord("pump-1", "alice", None, "set", {"value": n}, "accepted", "ok", 1.0, n, id=str(n)),
            0.0,
        )
        site.put(ResultRecord("pump-1", "alice", str(n), "set", Phase.CONFIRMED, "ok", "done", 2.0), 0.0)

    commands = site.commands("pump-1")
    assert [each["id"] for each in commands] == [str(n) for n in range(5, MOST_COMMANDS + 5)]
    assert commands[-1]["args"] == {"value": MOST_COMMANDS + 4}
    assert [each["phase"] for each in commands[-1]["phases"]] == ["accepted", "confirmed"]


def test_each_stop_without_an_id_is_a_command_of_its_own_once_the_one_before_has_ended() -> None:
    site = model()
    for n in range(2):
        happen(site, "result/pump-1/alice", b"%d" % n)
        for phase in (Phase.ACCEPTED, Phase.WRITTEN, Phase.CONFIRMED):
            site.put(ResultRecord("pump-1", "alice", None, "stop", phase, "ok", "", 1.0), 0.0)

    phases = [[each["phase"] for each in command["phases"]] for command in site.commands("pump-1")]
    assert phases == [["accepted", "written", "confirmed"]] * 2


def test_commands_of_what_is_not_configured_are_not_remembered() -> None:
    site = model(hall=("pump-1",))
    for n in range(1000):
        site.put(ResultRecord(f"x{n}", "alice", "1", "start", Phase.REJECTED, "", "", 1.0), 0.0)
    site.put(ResultRecord("hall", "alice", "1", "stop", Phase.CONFIRMED, "", "", 1.0), 0.0)

    assert len(site.commands("hall")) == 1
    assert site._commands.keys() == {"hall"}


def test_starts_and_trips_are_bounded_in_number_and_in_bytes() -> None:
    site = model()
    for n in range(40):
        happen(site, "starter/pump-1/start", b"%d" % n)
    assert [int(each) for each in site.records("pump-1", "start")] == list(range(20, 40))

    for n in range(400):
        happen(site, f"starter/pump-{n}/trip", b"x" * 16_000)
    assert site._record_bytes <= MOST_RECORD_BYTES


def test_facts_follow_what_a_starter_says_of_itself_and_the_groups_it_is_in() -> None:
    site = model(hall=("pump-1",))
    gen = site.gen

    retain(site, "starter/pump-1/info", b'{"model":"SSW-07 85A","firmware":null,"rated_current_a":85.0}')

    facts = site.facts_since(gen)["pump-1"]
    assert facts["model"] == "SSW-07 85A"
    assert "firmware" not in facts
    assert facts["groups"] == ["hall"]
    assert site.facts_since(site.gen) == {}


def test_another_configuration_forgets_what_it_does_not_name() -> None:
    site = model()
    site.put(ResultRecord("pump-1", "alice", "1", "stop", Phase.CONFIRMED, "", "", 1.0), 0.0)

    site.move(shown_site("fan"))

    assert site.commands("pump-1") == []
    assert list(site.site.starters) == ["fan"]
