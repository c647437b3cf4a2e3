"""What clients send wrong: topics, payloads, keys, types, sizes, too much; and the audit."""

from __future__ import annotations

import pytest

from tests.rig import (
    ScenarioRow,
    command,
    frames,
    msg,
    play,
    result,
    row,
    seen,
)
from tests.rig.sites import ALICE, QUICK, SSW07

SITE = SSW07 + ALICE


ARGUMENTS = [
    row(
        f"{verb} with {args}",
        given=SITE,
        at={3.0: command(f"pump/alice/{verb}", args=args)},
        then={4.0: [result(f"{verb} rejected {code}"), frames("pump")]},
    )
    for verb, args, code in (
        ("start", {"value": True}, "bad_arguments"),
        ("jog", {}, "bad_arguments"),
        ("jog", {"value": "perhaps"}, "bad_arguments"),
        ("direction", {"value": "sideways"}, "bad_arguments"),
        ("set", {"parameter": "P314"}, "bad_arguments"),
        ("set", {"parameter": "P314", "value": 3, "quickly": True}, "bad_arguments"),
        ("read", {}, "bad_arguments"),
        ("output", {"output": "RL9", "value": True}, "bad_arguments"),
    )
]

AUDIT = [
    row(
        "the audit has each decision, with who claims to have decided, and what was read before and after",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start", operator="Alice A.", reason="shift 2", id="one")},
        then={
            6.0: [
                seen("audit", decision="accepted", times=1),
                msg(
                    "audit",
                    starter="pump",
                    client="alice",
                    verb="start",
                    id="one",
                    decision="confirmed",
                    code="ok",
                    operator="Alice A.",
                    reason="shift 2",
                    before={"running": False},
                    after={"running": True},
                ),
            ]
        },
    ),
]


@pytest.mark.parametrize("row", ARGUMENTS + AUDIT)
def test_what_comes_of_a_payload_and_its_topic(row: ScenarioRow) -> None:
    play(row)
