"""In which form a request goes out; pure.

A poll may be read in another form, which says the same in a reply of another shape. A job is asked exactly
as it is: what another device would answer to another form may be the very question. Where no form is free a
fence goes first: its answer, or its refusal, proves that the unit is in step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any, Self

from gateway.line.rtu.outstanding import Outstanding, Shape, expected_shape
from gateway.modbus import Function, ReadHoldingRegisters, ReadInputRegisters, Request, adu

GIVEN_UP_S = 3600.0  # a form that was refused is tried again after that

# A read that says what another does, by a reply of another shape; and what takes the other's value from it.
Alternate = tuple[Request, Callable[[Any], Any]]
Alternates = Callable[[Request], tuple[Alternate, ...]]

# Their normal reply repeats the request [APP 6.5, 6.6, 6.16], so it looks like an adapter's echo.
_MIRRORED = frozenset({Function.WRITE_COIL, Function.WRITE_REGISTER, Function.MASK_WRITE_REGISTER})
_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


def no_alternates(request: Request) -> tuple[Alternate, ...]:  # noqa: ARG001
    """Return none: nothing is known of what else says the same."""
    return ()


@dataclass(frozen=True)
class Forms:
    """The other forms of requests to the starters of one family."""

    alternates_of: Alternates
    fences: tuple[Request, ...]  # reads that are answered or refused, of different shapes
    decisions: tuple[Request, ...] = ()  # what commands read, which may take longer than every poll

    @cached_property
    def fence_shapes(self) -> tuple[Shape, ...]:
        """The shapes of the fences' replies."""
        return tuple(expected_shape(fence) for fence in self.fences)


# Of a device of which nothing is known: whatever it does not have it refuses, and that is an answer too.
ANYONE = Forms(
    no_alternates,
    tuple(read(0, count) for count in range(1, 5) for read in (ReadHoldingRegisters, ReadInputRegisters)),
)


@dataclass(frozen=True, slots=True)
class EncodedRequest:
    """One request to one unit, ready to be sent."""

    unit: int
    request: Request
    adu: bytes
    reply_size: int | None  # of the normal reply's ADU; None = only the reply shows it
    is_mirrored: bool
    shape: Shape
    head: bytes  # of the normal reply's ADU: unit and shape
    cut: Callable[[Any], Any] | None = None  # from an alternate's value to that of the row
    is_fence: bool = False  # it goes before what is wanted

    @classmethod
    def of(
        cls,
        unit: int,
        request: Request,
        *,
        cut: Callable[[Any], Any] | None = None,
        is_fence: bool = False,
    ) -> Self:
        """Prepare a request; ValueError for what no frame can hold."""
        size, shape = request.reply_size(), expected_shape(request)
        return cls(
            unit,
            request,
            adu.encode(unit, request.encode()),
            None if size is None else size + _ADU_EXTRA,
            request.function in _MIRRORED,
            shape,
            bytes((unit,)) + shape,
            cut,
            is_fence,
        )


class FormChoice:
    """Chooses the forms on one line, by what is outstanding there."""

    def __init__(self) -> None:
        self.outstanding = Outstanding()
        self._given_up: dict[tuple[int, Request], float] = {}  # until when a unit is not asked in this form

    def choose(
        self, wanted: EncodedRequest, forms: Forms, now_s: float, *, is_poll: bool = False
    ) -> EncodedRequest:
        """Return what is to be sent now for the wanted request: itself, an alternate of a poll, or a fence.

        A stop is not asked about: it is sent as it is.
        """
        unit, outstanding = wanted.unit, self.outstanding
        if not outstanding.is_in_step(unit):
            outstanding.expire(unit, now_s)
        if outstanding.is_in_step(unit):
            return wanted
        found: list[Alternate | None] = [] if wanted.request.is_write else [None]  # None: as it is
        if is_poll:
            others = forms.alternates_of(wanted.request)
            found += [each for each in others if self._given_up.get((unit, each[0]), -inf) <= now_s]
        shapes = [wanted.shape if each is None else expected_shape(each[0]) for each in found]
        at = outstanding.choose(unit, shapes, forms.fence_shapes)
        if at >= len(found):
            return EncodedRequest.of(unit, forms.fences[at - len(found)], is_fence=True)
        chosen = found[at]
        return wanted if chosen is None else EncodedRequest.of(unit, chosen[0], cut=chosen[1])

    def give_up(self, sent: EncodedRequest, now_s: float) -> None:
        """Give up an alternate that a unit seems to refuse."""
        if sent.cut is not None:
            self._given_up[sent.unit, sent.request] = now_s + GIVEN_UP_S

    def retry_refused(self, unit: int) -> None:
        """Ask a unit in all forms again: another device answers there now."""
        self._given_up = {key: until_s for key, until_s in self._given_up.items() if key[0] != unit}
