"""A simulated starter and people at it as a script: PDUs in, PDUs out, a step a line or between semicolons.

    given P313=1 firmware='1.30'      first: parameters and options of the starter
    5 s                               time passes
    VB03 := 0101h; P313 := 0 5        writes one register (FC06), several (FC16), answered normally
    coil 100 := 1; coil 100 := 1 1    writes one coil (FC05), several (FC15)
    VB01 = 4102h; coil 100 = 1 1      reads and compares
    VB01 & 81h = 80h                  compares some bits
    07 00 00 -> 87 01                 sends the bytes of a request and compares those of the answer,
                                      in which 'WEG' is a text behind its length
    P089 refused 2; P313 x3 refused 2; P000 := 1 refused 3; VB01 silent; VB03 := 1 sent
                                      the exception; no answer; whichever
    start; stop; run                  the family's command; a start and 10 s
    see motor.state ramp_down; see starts 0.0; trips E28@5.0
                                      looks at the simulated starter itself
    do set_control usb                calls it, as somebody beside it does
    let received 7                    sets what is within it
    join 19200 8E1; listens 19200 8E1; ignores 9600 8N2
                                      is put on a line; whether it understands one
    trip E05; keypad start            a knob of `gateway.sim.controls`

`P`, `VB` are parameters and variables of a WEG starter, `R` registers of an SST, a bare number a net id,
coils as they are printed.
"""

from __future__ import annotations

import ast
import enum
import re
from collections.abc import Iterable
from operator import attrgetter
from typing import Any

import pytest

from gateway.modbus.pdu import Request, exception_code
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.sim.controls import KNOBS, set_knob
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

START = {
    "ssw06": "VB03 := 0101h",
    "ssw07": "coil 100 := 1",
    "ssw900": "685 := 13h",
    "sst": "coil 1 := 1",
}
STOP = {"ssw06": "VB03 := 0100h", "ssw07": "coil 100 := 0", "ssw900": "685 := 12h", "sst": "coil 1 := 0"}
_PLACE = re.compile(r"(?:(coil) )?([A-Z]*?)(\d+)(?: x(\d+))?")
_END = re.compile(r"\s+(?:refused (?P<code>\d+)|(?P<silent>silent)|(?P<sent>sent))$")


def play(family: str, script: str) -> Talk:
    """Act a script out on a new starter of this family; fails at the first step that is not so."""
    lines = [line.strip() for line in re.split(r"[;\n]", script) if line.strip()]
    given = lines.pop(0)[6:] if lines[0].startswith("given ") else ""
    talk = Talk(make_unit(family, 1, **options_of(given)))
    for line in lines:
        step(talk, line)
    return talk


def options_of(given: str) -> dict[str, Any]:
    """Return the options of `make_unit`: parameters by their number, and others by name."""
    options: dict[str, Any] = {}
    for name, text in (each.split("=", 1) for each in re.findall(r"\w+=(?:'[^']*'|\{[^}]*\}|\S+)", given)):
        number = re.fullmatch(r"[PR]?(\d+)", name)
        target = options.setdefault("settings", {}) if number else options
        target[int(number[1]) if number else name] = ast.literal_eval(text)
    return options


def step(talk: Talk, line: str) -> None:
    """Do one step."""
    unit, (word, _, rest) = talk.unit, line.partition(" ")
    if word in ("start", "stop", "run"):
        step(talk, (STOP if word == "stop" else START)[unit.family])
        talk.wait(10.0 if word == "run" else 0.0)
    elif word == "see":
        name, *wanted = rest.split()
        assert shown(attrgetter(name)(unit)) == wanted, line
    elif word == "trips":
        assert [f"{trip.code}@{trip.at_s}" for trip in unit.trips] == rest.replace("-", "").split(), line
    elif word == "do":
        do(unit, rest)
    elif word == "let":
        path, value = rest.split()
        owner, _, name = f"unit.{path}".rpartition(".")
        setattr(attrgetter(owner)(talk), name, ast.literal_eval(value))
    elif word == "join":
        unit.join(timing_of(rest))
    elif word in ("listens", "ignores"):
        assert unit.listens_to(timing_of(rest)) is (word == "listens"), line
    elif word in KNOBS:
        set_knob(unit, word, rest)
    elif rest == "s":
        talk.wait(float(word))
    elif "->" in rest:
        sent, reply = line.split("->")
        reply = re.sub("'(.*?)'", lambda text: f"{len(text[1]):02X}{text[1].encode().hex()}", reply)
        said = unit.handle(bytes.fromhex(sent), talk.now_s) or b""
        assert said.hex(" ") == bytes.fromhex(reply).hex(" "), line
    else:
        ask(talk, line)


def timing_of(text: str) -> LineTiming:
    """Return the timing of a line as `19200 8E1`."""
    baud, framing = text.split()
    return LineTiming(int(baud), Framing.parse(framing))


def do(unit: SimulatedUnit, call: str) -> None:
    """Call a method: `set_alarm 5 is_on=True`."""
    name, *words = call.split()
    named = dict(word.split("=") for word in words if "=" in word)
    plain = [int(word) if word.isdigit() else word for word in words if "=" not in word]
    getattr(unit, name)(*plain, **{key: ast.literal_eval(text) for key, text in named.items()})


def shown(value: Any) -> list[str]:
    """Return a value of the starter as scripts write it: a list as its words."""
    values = value if isinstance(value, (list, set, tuple)) else [value]
    return [each.name.lower() if isinstance(each, enum.Enum) else str(each) for each in values]


def ask(talk: Talk, line: str) -> None:
    """Send a request and compare what the starter answers."""
    end = _END.search(line)
    body = line[: end.start()] if end else line
    place, sign, given = re.fullmatch(r"(.*?)(?: (:?=|& \w+ =) (.*))?", body).groups()  # type: ignore[union-attr]
    values = tuple(number(word) for word in (given or "").split())
    request = request_of(talk.unit.family, place, values, is_write=sign == ":=")
    reply = talk.pdu(request)
    if end and end["sent"]:
        return
    assert (reply is None) is bool(end and end["silent"]), line
    if reply is None:
        return
    code = exception_code(request, reply)
    assert code == (int(end["code"]) if end else None), line
    if code is None and sign != ":=":
        mask = number(sign.split()[1]) if sign.startswith("&") else 0xFFFF
        assert tuple(int(word) & mask for word in request.decode_reply(reply)) == values, (line, reply.hex())


def request_of(family: str, place: str, values: tuple[int, ...], *, is_write: bool) -> Request:
    """Return the read or write of a place as its manual names it."""
    found = _PLACE.fullmatch(place)
    assert found, f"no step: {place}"
    kind, address, count = found[1] or found[2], int(found[3]), int(found[4] or len(values) or 1)
    address += {"VB": 5000}.get(kind, -1 if (kind, family) == ("coil", "sst") else 0)
    if not is_write:
        read = {
            "coil": ReadCoils,
            "DI": ReadDiscreteInputs,
            "R": ReadInputRegisters,
            "IR": ReadInputRegisters,
        }
        return read.get(kind, ReadHoldingRegisters)(address, count)
    if kind == "coil":
        bits = tuple(map(bool, values))
        return WriteCoil(address, bits[0]) if len(bits) == 1 else WriteCoils(address, bits)
    return WriteRegister(address, values[0]) if len(values) == 1 else WriteRegisters(address, values)


def number(word: str) -> int:
    """Return a number as manuals write it: 0101h or 257."""
    return int(word[:-1], 16) if word.endswith("h") else int(word)


def rules(family: str, scripts: dict[str, str]) -> Iterable[Any]:
    """Return the rows of a table: family, script; named by its sentence."""
    return [pytest.param(family, script, id=sentence) for sentence, script in scripts.items()]
