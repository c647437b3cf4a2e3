"""Faults of replies, injected on request: an impairment replaces one reply by what is sent instead."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Protocol

from gateway.modbus import decode, encode


@dataclass(frozen=True, slots=True)
class Reply:
    """A frame on its way from a unit."""

    adu: bytes
    after_s: float  # from the request's last byte to the first of this
    deadline_s: float  # the longest time that the unit's manual allows for it


class Impairment(Protocol):
    """Something that happens to replies; pure but for the dice it is given."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return what is sent instead of this reply, in the order of time."""


@dataclass(frozen=True, slots=True)
class NoReply:
    """Acts, but does not answer."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:  # noqa: ARG002
        """Return nothing."""
        return ()


@dataclass(frozen=True, slots=True)
class Late:
    """Answers so many times later than the manual allows."""

    times: float = 2.0

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:  # noqa: ARG002
        """Return the reply after its deadline."""
        return (replace(reply, after_s=self.times * reply.deadline_s),)


@dataclass(frozen=True, slots=True)
class Noisy:
    """Bits are flipped at this rate."""

    bit_error_rate: float = 0.001

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return the reply with some bits wrong."""
        return (replace(reply, adu=self.flip(reply.adu, dice)),)

    def flip(self, frame: bytes, dice: random.Random) -> bytes:
        """Return the bytes with some bits wrong."""
        return bytes(
            byte ^ sum(1 << bit for bit in range(8) if dice.random() < self.bit_error_rate) for byte in frame
        )


@dataclass(frozen=True, slots=True)
class WrongUnit:
    """Answers in the name of another unit, with a right CRC."""

    address: int

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:  # noqa: ARG002
        """Return the reply with the other's address."""
        return (replace(reply, adu=encode(self.address, decode(reply.adu).pdu)),)


@dataclass(frozen=True, slots=True)
class CutShort:
    """The end of each reply is missing."""

    missing_bytes: int = 2

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:  # noqa: ARG002
        """Return the beginning of the reply, if anything is left."""
        preserved = reply.adu[: -self.missing_bytes]
        return (replace(reply, adu=preserved),) if preserved else ()


@dataclass(frozen=True, slots=True)
class Doubled:
    """Sends each reply twice, the second time after a pause."""

    pause_s: float = 0.02

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:  # noqa: ARG002
        """Return the reply twice."""
        return reply, replace(reply, after_s=reply.after_s + self.pause_s)


@dataclass(slots=True)
class _InForce:
    impairment: Impairment
    left: int | None  # replies that it still concerns; None = until healed
    chance: float


class Impairments:
    """The impairments in force on a bus, by the address of the unit."""

    def __init__(self, dice: random.Random) -> None:
        self.dice = dice
        self._in_force: dict[int, _InForce] = {}

    def begin(self, address: int, impairment: Impairment, *, count: int | None, chance: float) -> None:
        """Impair a unit's next `count` replies, or until `end`; each with this chance."""
        self._in_force[address] = _InForce(impairment, count, chance)

    def end(self, address: int) -> None:
        """Send a unit's replies as they are."""
        self._in_force.pop(address, None)

    def apply(self, address: int, reply: Reply) -> tuple[Reply, ...]:
        """Return what a unit sends in the place of its reply."""
        found = self._in_force.get(address)
        if found is None or self.dice.random() >= found.chance:
            return (reply,)
        if found.left is not None:
            found.left -= 1
            if found.left <= 0:
                del self._in_force[address]
        return found.impairment.apply(reply, self.dice)
