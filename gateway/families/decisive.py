"""Which part of a block's answer decides state, faults and alarms, so that one reading may not be enough."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from gateway.families.blocks import Block
from gateway.families.fast_words import FastBlock
from gateway.families.schema import Parameter, Profile, Type

_FLAGS = (Type.BIT, Type.BITS, Type.ENUM, Type.LOW_ENUM)
_FAULT_CODE = "fault_code"


def decisive_part(profile: Profile, block: Block) -> Callable[[Any], Any] | None:
    """Return what takes the deciding words or bits from the block's value; None when it has none.

    Measured values are left out: two readings of those are seldom equal.
    """
    if block.group != "status":
        return None
    places = tuple(place for row, place in _places(block) if _decides(profile, row))
    return partial(_part, places=places) if places else None


def _places(block: Block) -> Iterator[tuple[Parameter, slice]]:
    offset = 0
    for row in block.rows:
        if not isinstance(block, FastBlock):
            offset = row.address - block.address
        yield row, slice(offset, offset + row.words)
        offset += row.words


def _decides(profile: Profile, row: Parameter) -> bool:
    if row.type in _FLAGS or row.code in profile.alarm_rows:
        return True
    points = [(name, point) for name, point in profile.points.items() if point.code == row.code]
    return any(name == _FAULT_CODE or point.bit is not None or point.true_when for name, point in points)


def _part(value: Sequence[Any], *, places: tuple[slice, ...]) -> tuple[Any, ...]:
    return tuple(tuple(value[place]) for place in places)
