"""A recorded day: all that a plant of all four families publishes in 24 virtual hours, as a golden file.

    python -m tests.rig.day            # plays the day, and prints the first differences from the record
    python -m tests.rig.day --write    # records it again, after a difference that is intended

The first hour is dense, so that it serves as a short form by itself; then come quiet hours with a few faults.
A line of the record is a message: milliseconds since the one before, topic, QoS, R if retained, payload.
Times of the payload are relative to the message where they are near, numbers (`seq`) to the one before, so
that a message more or less changes few lines. What carries chance, the version or the machine is masked,
numbers are cut to nine digits.
"""

from __future__ import annotations

import argparse
import datetime
import itertools
import json
import lzma
import re
import secrets
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import gateway
from tests.rig.broker import MqttMessage
from tests.rig.plant import RigPlant
from tests.rig.rows import Action, act, command, fault, publish, reload
from tests.rig.sites import HOME_ASSISTANT, SPARKPLUG, line, operator, starter, table
from tests.rig.world import EPOCH_S

RECORD = Path(__file__).with_name("day.txt.xz")
HOUR_S, DAY_S = 3600.0, 86400.0
NEAR_S = 60.0
SHOWN = 12  # topics with a difference
SLOW = {"every_s": 30.0}

BROKER = '[mqtt]\nurl = "mqtt://127.0.0.1"\nrefresh_s = 3600\n'
MILLS = line("mills") + starter("mill", 3, "ssw900", **SLOW) + starter("belt", 4, "sst", **SLOW)
PUMPS = line("pumps") + starter("pump", 1, "ssw07", **SLOW) + starter("fan", 2, "ssw06", **SLOW)
PEOPLE = operator("alice") + operator("bob", may=("start", "stop", "read"), starters=("pump", "fan"))
RULES = table("[rules]", starters=["fan"], starts_per_hour=3, minimum_pause_s=5.0) + table(
    "[rules]", starters=["mill"], two_step=["start"]
)
REST = PEOPLE + RULES + table("[group]", name="all", starters=["*"]) + HOME_ASSISTANT + SPARKPLUG
SITE = BROKER + PUMPS + MILLS + REST
WIDER = BROKER + PUMPS + starter("spare", 9, "ssw07", **SLOW) + MILLS.replace("30.0", "15.0") + REST


def do(words: str, **args: object) -> Action:
    """Send a verb of Alice's with these arguments."""
    name, verb = words.split()
    return command(f"{name}/alice/{verb}", args=args)


def selected(path: str) -> Action:
    """Return a command with the newest selection."""

    def send(plant: RigPlant) -> None:
        found = [each.json["select"] for each in plant.messages("result/#") if b'"select":' in each.payload]
        plant.command(path, select=found[-1])

    return send


FIRST_HOUR: dict[float, Action | tuple[Action, ...]] = {
    # Each family starts, is asked, is set, and refuses
    20: do("pump start"),
    30: do("fan start"),
    40: do("mill start"),  # refused: two steps
    41: do("mill select", verb="start"),
    42: selected("mill/alice/start"),
    50: do("belt start"),
    120: (do("pump read", parameter="P314"), do("mill read", parameter="S1.1.4")),
    125: (do("fan set", parameter="P314", value=30), do("belt set", parameter="R41", value=20)),
    130: (command("belt/bob/start"), command("pump/alice/reset", fresh=False), do("pump start")),
    132: publish("command/pump/alice/start", "no json", client="alice"),
    133: publish("command/Pump/alice/start", "{}", client="alice"),
    134: publish("command/pump/alice/start", '{"id": "old"}', client="alice", retain=True),
    136: (command("pump/bob/read", id="twice", args={"parameter": "P101"}),) * 2,
    140: do("pump direction", value="reverse"),
    150: (do("pump stop"), publish("command/fan/bob/stop", client="bob")),
    200: (do("fan start"), do("pump jog", value=True)),
    204: do("pump jog", value=False),
    210: (do("mill lock", reason="maintenance"), do("belt stop")),
    220: (do("mill stop"), do("mill unlock")),
    230: (do("pump general_enable", value=False), do("belt configure", R41=25)),
    240: do("pump general_enable", value=True),
    # Trips and alarms
    260: (do("pump start"), do("belt start")),
    300: ("pump trip E05", "mill alarm A005", "fan alarm"),
    305: do("pump start"),
    320: do("pump reset"),
    330: ("mill clear", "fan clear", "belt trip COIL12"),
    345: do("belt reset"),
    350: "mill trip F005",
    370: do("mill reset"),
    # People at the starters, and the mains
    400: ("pump control local", "belt control local"),
    410: do("pump start"),
    415: "pump keypad start",
    440: ("pump keypad stop", "pump control remote", "belt control remote"),
    460: "fan mains off",
    470: do("fan start"),
    500: ("fan mains on", "fan clear"),
    510: do("fan start"),
    530: "fan phase R",
    560: ("fan phase on", "fan clear"),
    # Replies that are lost, garbled, late or double; a starter that is away
    600: (do("pump start"), do("belt start")),
    620: (fault("lose", "pump", for_s=20), fault("garble", "belt", for_s=20)),
    630: do("pump stop"),
    660: (
        fault("delay", "pump", 0.3, for_s=10),
        fault("double", "mill", for_s=10),
        fault("cut", "fan", for_s=10),
    ),
    700: fault("refuse", "mill", 2, (3,), for_s=40),
    760: fault("silent", "fan", for_s=200),
    800: do("fan start"),
    860: do("fan stop"),
    1000: "belt power off",
    1150: "belt power on",
    1180: do("belt configure"),
    # The broker and the adapter
    1200: (do("pump start"), do("belt start")),
    1230: "broker down",
    1250: "pump trip E05",
    1300: "belt load 70",
    1350: "broker up",
    1370: do("pump reset"),
    1371: command("all/alice/stop"),
    1420: "broker stalls",
    1450: "broker goes",
    1500: "broker drops",
    1540: "line pumps unplug",
    1570: "line pumps plug",
    # Reloads, ends and a kill
    1620: (do("belt start"), do("pump start")),
    1640: reload(SITE + "wrong = 1\n"),
    1650: reload(WIDER),
    1700: command("all/alice/stop"),
    1750: reload(SITE),
    1800: "restart",
    1830: do("pump start"),
    1836: "kill",
    1840: "start",
    1900: command("all/alice/stop"),
    2000: do("mill select", verb="start"),
    2001: (do("mill cancel"), selected("mill/alice/start")),
    3000: do("pump start"),
    3300: do("pump stop"),
}
LATER: dict[float, Action | tuple[Action, ...]] = {  # by the hour
    2.0: (do("pump start"), do("belt start")),
    4.5: do("mill select", verb="start"),
    4.501: selected("mill/alice/start"),
    5.0: "belt load 90",
    6.0: "mill load 60",
    7.0: "pump trip E03",
    7.2: do("pump reset"),
    9.0: "broker down",
    9.05: "mill voltage 70 5",
    9.1: "broker up",
    9.5: do("mill reset"),
    11.0: ("belt power off", fault("silent", "fan", for_s=5400)),
    13.0: "belt power on",
    13.1: do("belt configure"),
    14.0: (do("pump start"), do("fan start"), do("belt start")),
    15.0: fault("lose", "pump", for_s=3),
    16.0: "fan thermal 90",
    18.0: command("all/alice/stop"),
    20.0: "restart",
    23.0: do("fan start"),
    23.9: do("fan stop"),
}
ENDS_S = DAY_S - 10.0


def day(until_s: float = DAY_S, *, seed: int = 0) -> list[str]:
    """Play the day up to a second of it; return its lines, masked."""
    at = {**FIRST_HOUR, **{hour * HOUR_S: each for hour, each in LATER.items()}, ENDS_S: "end"}
    with RigPlant(SITE, seed=seed, absent=("spare",), before=_without_jitter) as plant:
        for at_s in sorted(at):
            if at_s < until_s:
                plant.run(until=at_s)
                actions = at[at_s]
                for each in actions if isinstance(actions, tuple) else (actions,):
                    act(plant, each)
        plant.run(until=until_s)
        return list(_masked(plant.broker.log))


def _without_jitter(_: RigPlant) -> None:
    """Give all that asks for a seed the same one, in whatever order it asks; ends with the plant."""
    secrets.randbits = lambda _: 7


_TIME = re.compile(r'"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d+)?)Z"')
_STAMP = re.compile(r'"timestamp": (\d+)')
_SEQ = re.compile(r'"seq": ?(\d+)')
_CHANCE = re.compile(r'"(token|select|id)": ?"(?!id-\d+"|twice")[^"]+"')
_RUN = re.compile(r'"(boot|run)": ?"([^"]+)"')
_MACHINE = re.compile(r'"(Properties/(?:Hardware Make|OS Version))": "[^"]+"')
_LONG = re.compile(r"\d+\.\d{10,}(?:e-\d+)?")  # a sum: its last digits may be another machine's
_VERSION = f'"{gateway.__version__}"'


def _masked(messages: Iterable[MqttMessage]) -> Iterator[str]:
    last_ms = seq = 0
    runs = defaultdict[str, str](lambda: f"#{len(runs)}")  # by what names it: the first, the second ..

    def number(found: re.Match[str]) -> str:
        nonlocal seq
        before, seq = seq, int(found[1])
        return f'"seq":{seq - before:+d}'

    for each in messages:
        at_ms = round(each.at_s * 1000)

        def time(unix_s: float, at_ms: int = at_ms) -> str:
            day_ms = round((unix_s - EPOCH_S) * 1000)
            return f"{day_ms - at_ms:+d}" if abs(day_ms - at_ms) < NEAR_S * 1000 else f"@{day_ms}"

        if each.topic.startswith("spBv1.0/") and "/STATE/" not in each.topic:
            text = json.dumps(each.json)
            text = _STAMP.sub(lambda found: f'"timestamp": "{time(int(found[1]) / 1000)}"', text)
        else:
            text = each.payload.decode("utf-8", "backslashreplace")
            text = _SEQ.sub(number, text)
        text = _TIME.sub(
            lambda found: f'"{time(datetime.datetime.fromisoformat(found[1] + "+00:00").timestamp())}"', text
        )
        text = _LONG.sub(lambda found: f"{float(found[0]):.9g}", text)
        text = _RUN.sub(lambda found: f'"{found[1]}":"{runs[found[2]]}"', text)
        text = _MACHINE.sub(r'"\1": "MACHINE"', text)
        text = _CHANCE.sub(r'"\1":"*"', text).replace(_VERSION, '"VERSION"')
        flags = f"{each.qos}{'R' if each.retain else ''}"
        yield f"{at_ms - last_ms} {each.topic} {flags} {text}"
        last_ms = at_ms


# The record


def recorded() -> list[str]:
    return lzma.decompress(RECORD.read_bytes()).decode().splitlines()


def until(lines: list[str], end_s: float) -> list[str]:
    """Return the lines up to a second."""
    times_ms = itertools.accumulate(int(each.partition(" ")[0]) for each in lines)
    return [each for each, at_ms in zip(lines, times_ms, strict=True) if at_ms <= end_s * 1000]


def differences(expected: list[str], found: list[str]) -> str:
    """Return the first difference of each topic, in order of time; empty: all are equal."""
    if expected == found:
        return ""
    old, new = _by_topic(expected), _by_topic(found)
    topics = old.keys() | new.keys()
    first: list[tuple[int, str]] = []
    for topic in topics:
        before, now = old[topic], new[topic]
        for number, (was, is_) in enumerate(itertools.zip_longest(before, now), 1):
            if was != is_:
                at_ms = min(each[0] for each in (was, is_) if each is not None)
                head = f"{topic}, message {number} of {len(before)} (now {len(now)})"
                first.append((at_ms, f"{head}\n  was {_shown(was, is_)}\n  is  {_shown(is_, was)}"))
                break
    if not first:
        return "the order of messages of one moment differs: " + next(
            f"was {was}\n  is {is_}" for was, is_ in zip(expected, found, strict=True) if was != is_
        )
    first.sort()
    more = f"\nand {len(first) - SHOWN} topics more" if len(first) > SHOWN else ""
    head = f"{len(first)} of {len(topics)} topics differ; the first difference of each:\n"
    return head + "\n".join(text for _, text in first[:SHOWN]) + more


def _by_topic(lines: list[str]) -> defaultdict[str, list[tuple[int, str]]]:
    found = defaultdict(list)
    at_ms = 0
    for each in lines:
        after_ms, topic, rest = each.split(" ", 2)
        at_ms += int(after_ms)
        found[topic].append((at_ms, rest))
    return found


def _shown(message: tuple[int, str] | None, other: tuple[int, str] | None) -> str:
    """Return time and the part of a message in which it differs from the other."""
    if message is None:
        return "missing"
    at_s, text = message[0] / 1000, message[1]
    pairs = zip(text, other[1] if other else "", strict=False)
    same = next((at for at, (a, b) in enumerate(pairs) if a != b), 0)
    begin = max(0, same - 80)
    return f"{datetime.timedelta(seconds=at_s)} {'..' if begin else ''}{text[begin : same + 160]}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.rig.day", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--write", action="store_true", help="record the day again")
    parser.add_argument("--hours", type=float, default=24.0, help="compare only so many")
    args = parser.parse_args()
    if args.write:
        lines = day()
        RECORD.write_bytes(lzma.compress("".join(f"{each}\n" for each in lines).encode(), preset=9))
        print(f"{len(lines)} messages, {RECORD.stat().st_size} bytes")
        return 0
    wrong = differences(until(recorded(), args.hours * HOUR_S), day(args.hours * HOUR_S))
    print(wrong or "as recorded")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
