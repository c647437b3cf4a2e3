"""`send`: the phases that it shows, and exit code 0 only when the command is confirmed."""

from __future__ import annotations

import re

from tests.rig import RigPlant, command, frames, played, results, row, scene
from tests.rig.sites import ALICE, QUICK, SSW07, operator, starter, table
from tests.scenarios.cli.lines import beside, cli

BOB = operator("bob", may=("stop", "read"))
HALL = SSW07 + starter("fan", 2, "ssw06") + ALICE + table("[group]", name="hall", starters=["pump", "fan"])
BASE = "starters/plant"
START = "send CONFIG pump start"
CONFIRMED = "accepted\nwritten: being read back\nconfirmed: read back from the starter\n"


def _two_steps(plant: RigPlant) -> str:
    """Select a start, then start with the token that `send` has printed."""
    selected = plant.cli("send", "CONFIG", "pump", "select", "verb=start")
    token = re.search(r"^select=([0-9a-f]+) \(within 10\.0 s\)$", selected.out, re.MULTILINE)
    if selected.code or token is None:
        return selected.out + selected.err
    return cli(f"{START} select={token[1]}", out="confirmed")(plant)


SENDING = [
    beside(
        "a start is confirmed, and every phase shown",
        SSW07 + ALICE,
        cli(START, out=CONFIRMED, err=""),
        frames("pump", "05 00 64 ff 00"),
    ),
    scene(
        "a command that is refused says why, and that nothing was written",
        SSW07 + ALICE,
        {3.0: command("pump/alice/start")},
        6.0,
        cli(START, code=1, out=(re.compile(r"rejected \[motor_running\]: "), "nothing was written")),
    ),
    row(
        "a start that the starter does not follow is not confirmed",
        given=SSW07 + ALICE,
        at={3.0: "pump VB01 = 0x4102"},  # ready, whatever is written to it
        then={4.0: cli(START, code=1, out=("written: being read back", "unconfirmed [not_seen]"))},
    ),
    beside(
        "of several operators one must be named, and has that one's rights",
        SSW07 + ALICE + BOB,
        cli(START, code=2, out="", err="which operator? (--client with one of alice, bob)"),
        results(),
        cli(f"{START} --client bob", code=1, out="rejected [not_allowed]: bob has no right to start pump"),
        cli("send CONFIG pump stop --client bob", out="confirmed"),
    ),
    beside(
        "a setting is written and read back, and several values are read at once, each on a line",
        SSW07 + ALICE,
        cli(
            "send CONFIG pump set parameter=P314 value=30",
            out="confirmed: read back from the starter = 30.0 s",
        ),
        frames("pump", "06 01 3a 00 1e"),
        cli("send CONFIG pump read parameter=P314", out="confirmed: read = 30.0 s"),
        cli(
            "send CONFIG pump read parameters=P003,P220",
            out=re.compile(r"confirmed: read\n  P003 = 0.0 A\n  P220 = .+\n"),
        ),
    ),
    beside(
        "an expectation that does not hold prevents the start",
        SSW07 + ALICE,
        cli(
            f"{START} expect=state:running",
            code=1,
            out="rejected [not_as_expected]: state is ready, but the command expects running",
        ),
        frames("pump"),
        cli(f"{START} expect=state:ready,remote:true", out="confirmed"),
    ),
    beside(
        "where two steps are demanded, a start alone is refused",
        SSW07 + ALICE + table("[rules]", starters=["pump"], two_step=["start"]),
        cli(START, code=1, out="rejected [select_first]"),
        _two_steps,
    ),
    row(
        "a group is stopped by one command",
        given=HALL,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start")},
        then={6.0: cli("send CONFIG hall stop", out="confirmed: all 2 starters were read back")},
    ),
    beside(
        "without a final result in time the command has failed",
        SSW07 + ALICE,
        cli(f"{START} --timeout 0.01", code=1, err="no final result within 0.01 s: look at the starter"),
    ),
    *(
        row(
            f"a client that may not {access} {topic} is named with what it lacks",
            given=SSW07 + ALICE,
            before=lambda plant, denied=(topic, access): plant.broker.deny(
                "*", f"{BASE}/{denied[0]}", denied[1]
            ),
            then={3.0: cli(START, code=1, err=f"does not let a client without login {access} {what}")},
        )
        for access, topic, what in (
            ("read", "gateway/status", f"{BASE}/gateway/status"),
            ("read", "gateway/fresh", f"{BASE}/gateway/fresh"),
            ("read", "result/pump/alice", "the results of alice"),
            ("write", "command/pump/alice/start", f"{BASE}/command/pump/alice/start"),
        )
    ),
    beside(
        "another login than the gateway's has its own password",
        SSW07 + ALICE,
        cli(f"{START} --username alice --password-file DIR/alice.password", out="confirmed"),
        lambda plant: "" if plant.broker.logins[-1][1:] == ("alice", "hers") else f"{plant.broker.logins}",
        files={"alice.password": "hers\n"},
    ),
    row(
        "a broker of MQTT 3.1.1 is spoken to in it",
        given=SSW07 + ALICE,
        before=lambda plant: setattr(plant.broker, "speaks_5", False),
        then={3.0: cli(START, out="confirmed")},
    ),
    row(
        "a gateway that has ended, one that never was and a broker that is away are named; a stop goes out",
        given=SSW07 + ALICE,
        at={3.0: "end", 5.0: lambda plant: plant.broker.retained.clear(), 7.0: "broker down"},
        then={
            4.0: [
                cli(START, code=1, out="", err="the gateway is offline: ended by SIGTERM (start it)"),
                cli(
                    "send CONFIG pump stop", code=1, out="", err="the stop was sent, and no gateway answered"
                ),
            ],
            6.0: cli(
                START,
                code=1,
                err="no gateway has published its state in starters/plant/gateway/status (is it",
            ),
            8.0: cli(
                START,
                code=1,
                out="",
                err="broker 127.0.0.1:1883: nothing listens there (is the broker running?)",
            ),
        },
    ),
]


test_send = played(SENDING)
