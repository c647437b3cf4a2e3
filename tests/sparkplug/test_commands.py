"""DCMD: what becomes a command of the configured operator, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.plugins.sparkplug.commands import MOST_WRITES, CommandMapper, DeviceCommand, Judgement
from gateway.plugins.sparkplug.payload import decoded_command
from tests.sparkplug.support import EPOCH_S, dcmd, write

NOW_S = EPOCH_S + 100.0


def judged(
    *writes: dict[str, Any],
    time_s: float | None = NOW_S,
    is_retained: bool = False,
    born_s: float | None = EPOCH_S,
    starter: str = "pump",
) -> list[Judgement]:
    mapper = CommandMapper("scada", ttl_s=5.0)
    command = decoded_command(dcmd(*writes, time_s=time_s))
    assert command is not None
    return list(mapper.judge(DeviceCommand(starter, command, is_retained, 7.0, NOW_S, born_s)))


def code(judgement: Judgement) -> str:
    """Return why a write is refused; empty where it is a command."""
    refusal = judgement[1]
    return "" if refusal is None else refusal.code


def test_the_same_write_has_the_same_id_and_any_other_has_another() -> None:
    def id_of(*args: Any, **options: Any) -> str | None:
        ((request, refusal),) = judged(*args, **options)
        assert refusal is None
        return request.id

    first = id_of(write("Command/Start"))
    assert (first or "").startswith("spb-1760000100000-")

    assert id_of(write("Command/Start")) == first
    assert id_of(write("Command/Start"), starter="fan") != first
    assert id_of(write("Command/Reset")) != first
    assert id_of(write("Command/Start"), time_s=NOW_S + 0.001) != first


ODD = (  # beside true
    *({"datatype": number} for number in (12, 4, 0)),
    *({"int_value": 0}, {"long_value": 1}, {"string_value": "true"}, {"bytes_value": b"x"}),
    *({"dataset_value": b""}, {"template_value": b""}, {"extension_value": b""}),
)


@pytest.mark.parametrize(
    ("fields", "stops"),
    [
        ({}, False),
        ({"boolean_value": False}, False),
        ({"int_value": 1}, False),
        ({"string_value": "true"}, False),
        ({"is_null": True}, False),
        ({"boolean_value": True, "is_null": True}, False),
        *(({"boolean_value": True, **odd}, True) for odd in ODD),
    ],
)
@pytest.mark.parametrize("name", ["Command/Start", "Command/Reset", "Command/Stop"])
def test_only_true_acts_and_beside_another_type_or_value_it_stops_and_does_nothing_else(
    name: str, fields: dict[str, Any], *, stops: bool
) -> None:
    (judgement,) = judged({"name": name, **fields})

    assert code(judgement) == ("" if stops and name == "Command/Stop" else "bad_payload")


@pytest.mark.parametrize(
    ("more", "times", "refused"),
    [
        ({}, {"time_s": None}, "not_fresh"),
        ({}, {"born_s": None}, "before_connection"),
        ({}, {"born_s": NOW_S + 0.001}, "before_connection"),
        ({"is_historical": True}, {}, "expired"),
        ({"timestamp": round((NOW_S - 60) * 1000)}, {"born_s": NOW_S - 50}, "before_connection"),
        ({"timestamp": round((NOW_S + 60) * 1000)}, {"born_s": NOW_S + 50}, "before_connection"),
    ],
)
def test_a_start_that_is_not_fresh_is_refused(
    more: dict[str, Any], times: dict[str, Any], refused: str
) -> None:
    assert code(*judged(write("Command/Start", **more), **times)) == refused


@pytest.mark.parametrize("name", ["current", "command/start", "", "Command/Set", "Command/Last/Verb", "a\nb"])
def test_no_other_metric_can_be_written(name: str) -> None:
    assert code(*judged(write(name))) == "unknown_verb"


def test_a_stop_in_a_message_goes_first_and_a_flood_in_one_message_is_cut() -> None:
    found = judged(*[write("Command/Start")] * 100, write("Command/Stop"))

    assert len(found) == MOST_WRITES + 1
    assert (found[0][0].verb, code(found[0])) == ("stop", "")
    assert {code(each) for each in found[1:-1]} == {"bad_payload"}
    assert code(found[-1]) == "too_many"
    assert str(found[-1][1]) == "too_many: 81 more metrics are in the same DCMD: at most 20 are taken"
