"""Hypothesis strategies: every request, and every reply that answers it."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st

from gateway.modbus.device_id import ONE_OBJECT_CODE, DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import encode_exception
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import KnownRequest
from gateway.modbus.writes import (
    MaskWriteRegister,
    ReadWriteRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    WriteRegisters,
)

PROPERTY = settings(max_examples=150)

words = st.integers(0, 0xFFFF)
units = st.integers(1, 247)


@st.composite
def runs(draw: st.DrawFn, max_count: int) -> tuple[int, int]:
    """Address and count of a run inside the address space; both ends are likely."""
    count = draw(st.integers(1, max_count))
    return draw(st.integers(0, 0x10000 - count)), count


def word_tuples(count: int) -> st.SearchStrategy[tuple[int, ...]]:
    return st.binary(min_size=2 * count, max_size=2 * count).map(
        lambda raw: tuple(int.from_bytes(raw[at : at + 2]) for at in range(0, len(raw), 2))
    )


def bit_tuples(count: int) -> st.SearchStrategy[tuple[bool, ...]]:
    return st.integers(0, 2**count - 1).map(lambda bits: tuple(bool(bits >> at & 1) for at in range(count)))


def requests() -> st.SearchStrategy[KnownRequest]:
    return st.one_of(
        runs(2000).map(lambda run: ReadCoils(*run)),
        runs(2000).map(lambda run: ReadDiscreteInputs(*run)),
        runs(125).map(lambda run: ReadHoldingRegisters(*run)),
        runs(125).map(lambda run: ReadInputRegisters(*run)),
        st.builds(WriteCoil, words, st.booleans()),
        st.builds(WriteRegister, words, words),
        runs(1968).flatmap(lambda run: st.builds(WriteCoils, st.just(run[0]), bit_tuples(run[1]))),
        runs(123).flatmap(lambda run: st.builds(WriteRegisters, st.just(run[0]), word_tuples(run[1]))),
        st.builds(MaskWriteRegister, words, words, words),
        st.tuples(runs(125), runs(121)).flatmap(
            lambda both: st.builds(
                ReadWriteRegisters,
                st.just(both[0][0]),
                st.just(both[0][1]),
                st.just(both[1][0]),
                word_tuples(both[1][1]),
            )
        ),
        st.builds(ReadDeviceIdentification, st.integers(1, 4), st.integers(0, 255)),
    )


texts = st.text(st.characters(min_codepoint=0, max_codepoint=0xFF), max_size=40)


@st.composite
def identifications(draw: st.DrawFn, request: ReadDeviceIdentification) -> DeviceIdentification:
    if request.read_code == ONE_OBJECT_CODE:
        return DeviceIdentification(objects={request.object_id: draw(texts)})
    return DeviceIdentification(
        objects=draw(st.dictionaries(st.integers(0, 255), texts, max_size=5)),
        more_follows=draw(st.booleans()),
        next_object=draw(st.integers(0, 255)),
    )


@st.composite
def exchanges(draw: st.DrawFn) -> tuple[KnownRequest, Any, bytes]:
    """A request, what its reply says, and the reply's PDU."""
    request = draw(requests())
    match request:
        case ReadCoils() | ReadDiscreteInputs():
            bits = draw(bit_tuples(request.count))
            return request, bits, request.encode_reply(bits)
        case ReadHoldingRegisters() | ReadInputRegisters():
            values = draw(word_tuples(request.count))
            return request, values, request.encode_reply(values)
        case ReadWriteRegisters():
            values = draw(word_tuples(request.read_count))
            return request, values, request.encode_reply(values)
        case ReadDeviceIdentification():
            identification = draw(identifications(request))
            return request, identification, request.encode_reply(identification)
        case _:
            return request, None, request.encode_reply()


@st.composite
def reply_pdus(draw: st.DrawFn) -> bytes:
    """The PDU of a normal or of an exception reply."""
    request, _, pdu = draw(exchanges())
    return draw(st.sampled_from([pdu, encode_exception(request.function, draw(st.integers(0, 255)))]))
