from __future__ import annotations

import pytest

from gateway.contract import StateRecord, Topics, is_level, to_level


@pytest.mark.parametrize("name", ["", "Pump", "pump 1", "pump/1", "+", "#", "pumpe-ü", "pump\n"])
def test_a_name_that_is_no_level_makes_no_command(name: str) -> None:
    with pytest.raises(ValueError, match="is no topic level"):
        Topics("b").command(name, "alice", "stop")


@pytest.mark.parametrize("name", ["Pump", "pump 1", "pump/1", "+", "#", "pumpe-ü", "pump\n"])
def test_no_name_adds_a_level_or_a_wildcard_to_the_topic_of_a_record(name: str) -> None:
    *levels, leaf = Topics("b").of(StateRecord, starter=name).split("/")

    assert len(levels) == 3
    assert all(is_level(level) for level in [*levels, leaf])


@pytest.mark.parametrize(
    "topic", ["", "other/command/pump-1/alice/start", "b/result/pump-1/alice/start", "b/commands"]
)
def test_a_topic_that_is_not_below_command_is_none_of_ours(topic: str) -> None:
    assert Topics("b").parse_command(topic) is None


@pytest.mark.parametrize(
    ("topic", "known", "problem"),
    [
        ("b/command", ("", "", ""), "level_missing"),
        ("b/command/pump-1", ("", "", "pump-1"), "level_missing"),
        ("b/command/pump-1/stop", ("", "", "pump-1/stop"), "level_missing"),
        ("b/command/pump-1/alice/stop/", ("pump-1", "alice", "stop/"), "level_empty"),
        ("b/command/pump-1/alice/", ("pump-1", "alice", ""), "level_empty"),
        ("b/command/pump-1//start", ("", "", "pump-1//start"), "level_empty"),
        ("b/command//alice/start", ("", "", "/alice/start"), "level_empty"),
        ("b/command/pump-1/alice/start/now", ("pump-1", "alice", "start/now"), "level_too_many"),
        ("b/command/pump-1/alice/STOP", ("pump-1", "alice", "STOP"), "level_misspelt"),
        ("b/command/PUMP-1/alice/stop", ("pump-1", "alice", "stop"), "level_misspelt"),
        ("b/command/pump-1/Alice/stop", ("", "", "pump-1/Alice/stop"), "level_misspelt"),
        ("b/command/pump-1/alice/st art", ("pump-1", "alice", "st art"), "level_misspelt"),
        ("b/command/pump-1/alice/start\n", ("pump-1", "alice", "start?"), "level_misspelt"),
        ("b/command/+/alice/start", ("", "", "+/alice/start"), "level_misspelt"),
        ("b/command/pump-1/alice/\x00", ("pump-1", "alice", "?"), "level_misspelt"),
        ("b/command/pump-1/aliceï/start", ("", "", "pump-1/aliceï/start"), "level_misspelt"),
        (f"b/command/pump-1/alice/{'X' * 500}", ("pump-1", "alice", "X" * 39 + "…"), "level_misspelt"),
    ],
)
def test_of_a_mistyped_command_topic_is_reported_what_can_be(
    topic: str, known: tuple[str, str, str], problem: str
) -> None:
    found = Topics("b").parse_command(topic)

    assert found
    assert found[:3] == known
    assert found.problem == problem
    assert found.text.isprintable()
    assert len(found.text) < 200


@pytest.mark.parametrize(
    ("name", "level"),
    [("S1.2.1", "s1_2_1"), ("P002", "p002"), ("line_voltage", "line_voltage"), ("", "_"), ("É", "_")],
)
def test_a_manuals_code_becomes_a_level(name: str, level: str) -> None:
    assert to_level(name) == level
    assert is_level(level)
