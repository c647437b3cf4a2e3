"""Random input, in this process: frames, MQTT payloads, configurations, store contents, commands."""

from __future__ import annotations

import json
import logging
import random
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from gateway.config.load import parse
from gateway.errors import CodecError, ConfigError, GatewayError
from gateway.families.profile.load import FAMILIES
from gateway.modbus.adu import decode, encode, reply_adu_size
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.server import decode_request
from gateway.mqtt.contract.commands import CommandParser, Incoming
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.storage.database import Database
from tests.lab.torture.of_disk import damage
from tests.lab.torture.scenario import Row
from tests.modbus.request_size import request_adu_size
from tests.rules.random_commands import send_at_random

SITE = (Path(__file__).parents[3] / "config" / "plant.toml").read_text("utf-8")
BASE = "starters/plant"
_LEVELS = ("pump", "alice", "start", "stop", "set", "+", "#", "", "Ä", "a" * 200, "../x", "\x00")
_REPLIES = (b"\x03\x02\x00\x07", b"\x83\x02", b"\x05\x00\x63\xff\x00", b"\x10\x00\x01\x00\x02")
LIMIT_S = 1.0  # for one piece of input


@dataclass(frozen=True)
class FuzzScenario:
    """Some kind of input; `feed` returns the tally of what became of it, and raises for what must not be."""

    name: str
    feed: Callable[[random.Random, int], dict[str, int]]
    whole: int
    short: int

    def row(self, count: int, seed: int) -> Row:
        """Feed so many pieces and judge."""
        row = Row(self.name, f"{count} pieces")
        began_s = time.monotonic()
        logging.disable(logging.CRITICAL)
        try:
            row.measurements = dict(self.feed(random.Random(seed), count))
        except Exception as error:  # noqa: BLE001 - any exception is what we are looking for
            row.failures.append(f"{type(error).__name__}: {error}")
        finally:
            logging.disable(logging.NOTSET)
        row.took_s = time.monotonic() - began_s
        return row


def frames(dice: random.Random, count: int) -> dict[str, int]:
    """Decode frames as a master does, and beside pymodbus: what we accept it accepts too, and vice versa."""
    tally = {"accepted": 0, "refused": 0}
    theirs = FramerRTU(DecodePDU(False))
    for _ in range(count):
        frame = _frame(dice)
        try:
            adu = decode(frame)
        except CodecError:
            is_accepted = False
        else:
            is_accepted = True
            _decode_as_all(adu.pdu)
            if adu.pdu in _REPLIES and theirs.decode(frame)[3] != adu.pdu:
                raise AssertionError(f"read otherwise by pymodbus: {frame.hex(' ')}")
        for size_of in (reply_adu_size, request_adu_size):
            with suppress(CodecError):
                size_of(frame[: dice.randrange(len(frame) + 1)])
        is_theirs = len(frame) >= 4 and FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big"))
        if is_accepted and not is_theirs:
            raise AssertionError(f"accepted, but not by pymodbus: {frame.hex(' ')}")
        if is_theirs and not is_accepted and 4 <= len(frame) <= 256 and frame[0] <= 247:
            raise AssertionError(f"refused, but not by pymodbus: {frame.hex(' ')}")
        tally["accepted" if is_accepted else "refused"] += 1
    return tally


def _frame(dice: random.Random) -> bytes:
    """Return a random frame, or a right one that something happened to, or not."""
    kind = dice.randrange(4)
    if kind == 0:
        return dice.randbytes(dice.randrange(1, 300))
    pdu = dice.choice(_REPLIES)
    if kind == 1:
        pdu = bytes([dice.randrange(256)]) + dice.randbytes(dice.randrange(0, 252))
    frame = bytearray(encode(dice.randrange(1, 248), pdu))
    if kind == 3:
        for _ in range(dice.randrange(1, 4)):
            frame[dice.randrange(len(frame))] ^= 1 << dice.randrange(8)
    return bytes(frame)


def _decode_as_all(pdu: bytes) -> None:
    for read in (ReadHoldingRegisters(0, 1).decode_reply, decode_request):
        with suppress(CodecError):
            read(pdu)


def payloads(dice: random.Random, count: int) -> dict[str, int]:
    """Judge commands of every kind of wrongness; none may be accepted but by chance with all its proofs."""
    tokens = Tokens(RunToken("boot"), draw=lambda: "boot")
    tokens.issue(100.0)
    intake = CommandParser(Topics(BASE), tokens)
    tally: dict[str, int] = {}
    for _ in range(count):
        topic = f"{BASE}/command/{_level(dice)}/{_level(dice)}/{_level(dice)}"
        began_s = time.monotonic()
        incoming = Incoming(topic, _payload(dice), is_retained=dice.random() < 0.1)
        verdict = intake.judge(incoming, Moment(100.0, 1e9))
        if time.monotonic() - began_s > LIMIT_S:
            raise AssertionError(f"{len(incoming.payload)} bytes took {time.monotonic() - began_s:.1f} s")
        code = getattr(verdict, "code", "no command" if verdict is None else "accepted")
        tally[code] = tally.get(code, 0) + 1
    return tally


def _level(dice: random.Random) -> str:
    return dice.choice(_LEVELS if dice.random() < 0.1 else _LEVELS[:5])


def _payload(dice: random.Random) -> bytes:
    kind = dice.randrange(8)
    if kind == 0:
        return dice.randbytes(dice.randrange(0, 5000))
    if kind == 1:
        return b"[" * dice.randrange(1, 4000)
    if kind == 2:
        return b'{"id":' + b"9" * dice.randrange(1, 3900) + b"}"
    if kind == 3:
        return b'{"id":"a","id":"b","token":"boot"}'
    if kind == 4:
        return b"x" * (10 * 2**20 if dice.random() < 0.001 else 5000)
    values: tuple[Any, ...] = (None, True, -1, 1e308, "\ud800", [], {}, "x" * 300, "boot", 5)
    fields = {
        key: dice.choice(values) for key in ("id", "token", "boot", "ttl_s", "args", "operator", "issued_at")
    }
    text = json.dumps({key: value for key, value in fields.items() if dice.random() < 0.7})
    if kind == 5:
        text = text.replace("null", dice.choice(("NaN", "Infinity", "-Infinity")))
    if kind == 6:
        cut = dice.randrange(len(text) + 1)
        text = text[:cut] + chr(dice.randrange(1, 0xD800)) + text[cut:]
    return text.encode("utf-8", "surrogatepass")


def configurations(dice: random.Random, count: int) -> dict[str, int]:
    """Read mutated sites: each is right, or refused with a place and a reason."""
    tally = {"right": 0, "refused": 0}
    for _ in range(count):
        text = _mutated(dice)
        try:
            parse(text, "site.toml")
        except ConfigError as error:
            tally["refused"] += 1
            if not error.problems or not all(problem.what for problem in error.problems):
                raise AssertionError(f"refused without a reason: {text!r}") from error
        else:
            tally["right"] += 1
    return tally


def _mutated(dice: random.Random) -> str:
    lines = SITE.splitlines()
    for _ in range(dice.randrange(1, 4)):
        at = dice.randrange(len(lines))
        match dice.randrange(6):
            case 0:
                del lines[at]
            case 1:
                lines.insert(at, lines[dice.randrange(len(lines))])
            case 2:
                key = lines[at].partition("=")[0]
                lines[at] = f"{key}= {dice.choice(('-1', '1e999', 'nan', 'true', '[]', '{}', '2000-01-01'))}"
            case 3:
                place = dice.randrange(len(lines[at]) + 1)
                lines[at] = lines[at][:place] + chr(dice.randrange(1, 0xD800)) + lines[at][place:]
            case 4:
                lines[at] = lines[at][: dice.randrange(len(lines[at]) + 1)]
            case _:
                lines[at] = f'{lines[at].partition("=")[0]}= "{"x" * dice.choice((0, 1, 65, 5000))}"'
        if not lines:
            return ""
    return "\n".join(lines)


class _Notes:
    """A table, as the gateway's own are."""

    def create(self, connection: Any) -> None:
        connection.execute("CREATE TABLE IF NOT EXISTS notes (id INTEGER PRIMARY KEY, text TEXT)")
        connection.execute("SELECT id, text FROM notes LIMIT 1").fetchall()

    def make_room(self, connection: Any) -> None:
        connection.execute("DELETE FROM notes")


def stores(dice: random.Random, count: int) -> dict[str, int]:
    """Open damaged files: each can be used at once, or is put aside and a new one can."""
    tally = {"used": 0, "put aside": 0}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            path = Path(folder) / f"{number}.sqlite"
            table = _Notes()
            _filled(path, table)
            damage(path, dice)
            database = Database(path, [table], 2**20)
            aside = database.open()
            try:
                database.transact([lambda connection: connection.execute("SELECT * FROM notes").fetchall()])
            except GatewayError as error:  # damage that only a reader finds
                aside = database.replace(error)  # type: ignore[arg-type] # of that kind
            database.transact([_add])
            database.close()
            tally["put aside" if aside else "used"] += 1
            for each in Path(folder).iterdir():
                each.unlink()
    return tally


def _add(connection: Any) -> None:
    connection.execute("INSERT INTO notes (text) VALUES (?)", ("some note " * 20,))


def _filled(path: Path, table: _Notes) -> None:
    database = Database(path, [table], 2**20)
    database.open()
    database.transact([_add] * 100)
    database.close()


def random_commands(dice: random.Random, count: int) -> dict[str, int]:
    """Send commands to each family, as many to one as to the other, with faults and other hands between."""
    tally = {"starts": 0, "stops": 0}
    for family in FAMILIES:
        for keeps_run_command in (False, True):
            few = count // (2 * len(FAMILIES))
            ends = send_at_random(family, few, keeps_run_command=keeps_run_command, seed=dice.random())
            tally["starts"] += ends.get("start confirmed", 0)
            tally["stops"] += ends.get("stop confirmed", 0)
    return tally


SCENARIOS = (
    FuzzScenario("fuzz frames", frames, 1_000_000, 20_000),
    FuzzScenario("fuzz payloads", payloads, 100_000, 2_000),
    FuzzScenario("fuzz configurations", configurations, 10_000, 100),
    FuzzScenario("fuzz store contents", stores, 1_000, 20),
    FuzzScenario("random commands", random_commands, 40_000, 4_000),
)
