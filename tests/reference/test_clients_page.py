"""The examples of docs/clients.md are sound, and so is the flow for Node-RED."""

from __future__ import annotations

import json

from tests.reference.examples import FLOW, blocks


def test_the_python_example_compiles() -> None:
    compile(blocks("clients.md", "python")[0], "docs/clients.md", "exec")


def test_the_flow_can_be_imported_and_its_wires_lead_somewhere() -> None:
    nodes = {node["id"]: node for node in json.loads(FLOW)}

    ends = [end for node in nodes.values() for outputs in node.get("wires", []) for end in outputs]
    brokers = [node["broker"] for node in nodes.values() if node["type"] in ("mqtt in", "mqtt out")]
    assert set(ends) | set(brokers) <= nodes.keys()


def test_nothing_in_the_flow_is_retained_or_queued() -> None:
    nodes = json.loads(FLOW)

    assert {node["retain"] for node in nodes if node["type"] == "mqtt out"} == {"false"}
    assert {node["cleansession"] for node in nodes if node["type"] == "mqtt-broker"} == {True}


def test_what_the_examples_send_is_proven_by_a_token() -> None:
    for text in (blocks("clients.md", "sh")[0], FLOW):
        assert "gateway/fresh" in text
        assert "boot" not in text
