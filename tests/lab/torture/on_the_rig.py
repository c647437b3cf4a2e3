"""A whole gateway in virtual time: a noisy line, and payloads that are no commands."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Iterator
from functools import partial

from gateway.sim.bus.faults import Noisy
from tests.lab.torture.recorder import is_final
from tests.lab.torture.scenario import Row, Scenario
from tests.lab.torture.truth import Truth, never_had
from tests.rig import RigPlant

STARTERS = ("pump", "fan", "mill", "belt")
PACE_S = 0.24  # between commands of one client to one starter, so that none is refused as too many
ENDED_S = 5.0  # a read that was accepted is over by then
RUN_S, REST_S = 15.0, 165.0  # more starts would trip the overload
BIT_ERRORS = 0.02  # of a corrupted reply
UNDETECTED = 20_000  # one of so many corrupted frames passes a CRC-16 (1 in 51,000 with 1-6 wrong bits)
STARTED = "pump"
MOVING = ("starting", "running", "stopping")


def noise(plant: RigPlant, row: Row, count: int, _seed: int, *, share: float) -> None:
    """Corrupt this share of all replies; start and stop one motor again and again.

    Nothing false is shown as good, nothing false confirmed.
    """
    line, units = plant.lines["pumps"], {name: plant.starter(name).unit for name in STARTERS}
    truths = {name: Truth(unit, name) for name, unit in units.items()}
    noisy_s = plant.world.now_s() + 60.0  # until then every point was read once, rightly
    plant.run(until=noisy_s)
    for unit in units.values():
        line.bus.impair(unit.address, Noisy(BIT_ERRORS), chance=share)
    unit, starts, confirmed = units[STARTED], 0, 0
    while (handled := sum(each.handled for each in units.values())) < count or not starts:
        started, starts = len(unit.starts), starts + 1
        id_ = plant.command(f"{STARTED}/alice/start")
        plant.run(until=plant.world.now_s() + RUN_S)
        phases = [each.json["phase"] for each in plant.messages("result/+/+") if each.json["id"] == id_]
        confirmed += "confirmed" in phases
        is_false = "confirmed" in phases and len(unit.starts) == started
        row.check(not is_false, f"{id_} is said to be confirmed, but nothing was started")
        plant.publish(f"command/{STARTED}/alice/stop")
        plant.run(until=plant.world.now_s() + REST_S)

    def shown(topic: str) -> Iterator[tuple[list[str], dict[str, object]]]:
        for each in plant.messages(topic, since=noisy_s):
            if each.json["quality"] == "good":
                yield each.topic.split("/"), each.json

    good = {(at[-3], at[-1], json.dumps(body["value"])) for at, body in shown("starter/+/value/+")}
    false = never_had(good, {name: truth.values for name, truth in truths.items()})
    moving = {at[-2] for at, body in shown("starter/+/state") if body["state"] in MOVING}
    row.check(len(false) <= 1 + share * handled / UNDETECTED, f"shown as good, never had: {false[:3]}")
    row.check(moving <= {STARTED}, f"shown as moving: {moving}")
    row.check(
        len(unit.start_frames) <= starts, f"{len(unit.start_frames)} start frames for {starts} commands"
    )
    row.check(confirmed > 0, "no start was confirmed")
    row.check(not line.violations, f"line violations: {line.violations[:3]}")
    row.measurements = {"transactions": handled, "starts": starts, "confirmed": confirmed}
    row.measurements |= {"good values": len(good), "false values": len(false)}


def malformed(plant: RigPlant, row: Row, count: int, seed: int) -> None:
    """Publish that many, slowly enough for each to get an answer of its own.

    Each is refused once, with a reason, and nothing is written.
    """
    since_s, fresh, dice = plant.world.now_s(), plant.topic("gateway/fresh"), random.Random(seed)
    for number in range(1, count + 1):
        token = next(each for each in reversed(plant.broker.log) if each.topic == fresh).json["token"]
        verb, payload = payload_of(number, str(token), dice)
        starter = STARTERS[number % len(STARTERS)]
        plant.publish(f"command/{starter}/alice/{verb}", payload, client="alice")
        if number % len(STARTERS) == 0:
            plant.run(until=plant.world.now_s() + PACE_S)
    plant.run(until=plant.world.now_s() + ENDED_S)
    finals = [each.json for each in plant.messages("result/+/+", since=since_s) if is_final(each.json)]
    wrong = [each for each in finals if each["phase"] != "rejected" or not each["code"] or not each["text"]]
    writes = [write for name in STARTERS for write in plant.starter(name).writes]
    delivered = count - count // BIG_EVERY  # the broker keeps to the largest packet that we take
    codes = Counter(each["code"] for each in finals)
    row.check(len(finals) == delivered, f"{len(finals)} final results for {delivered} payloads")
    row.check(not wrong, f"not refused: {wrong[:3]}")
    row.check(not writes, f"the line was written to: {writes[:3]}")
    row.check("too_many" not in codes, f"{codes['too_many']} got no reason of their own")
    row.measurements = dict(codes.most_common())


BIG_BYTES = 1_000_000
BIG_EVERY = 5000  # one in so many
VERBS = ("start", "set", "read", "reset", "jog", "direction", "general_enable")  # a stop needs no payload
SETS = (6, 7)  # the kinds that are sent as `set`
NAMES = ("+", "#", "P+", "P#", "pump-*", "$SYS", "P314/#", "a/b", "", " ", "P314\u0000", "../../etc", "％")
NUMBERS = (2**63, -(2**64), 10**18, 10**400, -1, 2**31, 65536)
WORDS = ("NaN", "Infinity", "-Infinity", "1e999", "-1e400", "nan", "0x10", "01", "+1")
NOT_UTF8 = (b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\xf8\x88\x80\x80\x80", b"\xe2\x82")
KEYS = ("id", "token", "operator", "reason", "issued_at", "ttl_s", "args", "expect")
UNKNOWN = ("Id", "verb", "now", "$where", "__proto__", "\x00")
NO_OBJECTS = (b"[]", b"null", b"1", b'"start"', b"true", b"", b" ", b"\x00", b"{}{}", b"\xef\xbb\xbf{}")


def payload_of(number: int, token: str, dice: random.Random) -> tuple[str, bytes]:
    """Return a verb and a payload that must not be acted on, though its token is right."""
    if number % BIG_EVERY == 0:
        return "start", b'{"id":"' + b"x" * BIG_BYTES + b'"}'
    fields: dict[str, object] = {"id": f"bad-{number}", "token": token}
    kind = number % 12

    def text(**more: object) -> str:
        return json.dumps(fields | more)

    def number_of(word: str) -> bytes:
        return text(args={"parameter": "P314", "value": "@"}).replace('"@"', word).encode()

    match kind:
        case 0:  # no JSON
            payload = dice.randbytes(dice.randrange(1, 200)).replace(b"{", b"(")
        case 1:  # cut
            whole = text(args={"parameter": "P314", "value": 30})
            payload = whole[: dice.randrange(len(whole))].encode()
        case 2:  # deep
            depth, (begin, end) = dice.randrange(9, 1500), dice.choice((("[", "]"), ('{"a":', "}")))
            payload = text().replace("}", f', "args": {{"a": {begin * depth}1{end * depth}}}}}').encode()
        case 3:  # no number
            payload = number_of(dice.choice(WORDS))
        case 4:  # a key twice
            key, whole = dice.choice(("id", "token", "args")), text(args={})
            payload = f'{whole[:-1]}, "{key}": {json.dumps({**fields, "args": {}}[key])}}}'.encode()
        case 5:
            payload = text(operator="@").encode().replace(b"@", dice.choice(NOT_UTF8))
        case 6:  # a huge number
            digits = "9" * dice.randrange(20, 3000) if dice.random() < 0.5 else str(dice.choice(NUMBERS))
            payload = number_of(digits)
        case 7:  # wild names
            payload = text(args={"parameter": dice.choice(NAMES), "value": 1}).encode()
        case 8:  # a wrong type
            key = dice.choice(KEYS)
            payload = text(
                **{key: dice.choice(([], [1], True, [[]], "5" if key == "ttl_s" else "\x1b[2J"))}
            ).encode()
        case 9:
            payload = text(**{dice.choice(UNKNOWN): 1}).encode()
        case 10:  # too large
            payload = text(reason="r" * dice.randrange(4097, 60_000)).encode()
        case _:
            payload = dice.choice(NO_OBJECTS)
    return "set" if kind in SETS else dice.choice(VERBS), payload


SCENARIOS = (
    *(
        Scenario(f"errors {percent} %", None, partial(noise, share=percent / 100), 100_000, 1_500, "frames")
        for percent in (1, 3, 10)
    ),
    Scenario("malformed payloads", None, malformed, 20_000, 400, "payloads"),
)
