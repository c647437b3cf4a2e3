"""What a starter or a line does to the requests of a command, on order."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gateway.line.rtu.outcome import Answered, Outcome, Refused
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil
from tests.starters.fakes import AT_SPEED, VB01
from tests.starters.rig import CommandRig

ACCEPTED, WRITTEN, CONFIRMED = ("accepted", "ok"), ("written", "ok"), ("confirmed", "ok")


async def ready(family: str = "ssw07", *, is_snapshot_old: bool = False) -> CommandRig:
    rig = CommandRig(family)
    await rig.online()
    if is_snapshot_old:
        await asyncio.sleep(10.0)
        rig.sink.clear()
    return rig


def ignore(_request: Request) -> None:
    """Be a starter that acknowledges a command and does nothing."""


def false_reading(rig: CommandRig, word: int) -> Callable[[Request], Outcome | None]:
    """Let the next reading of the status word be wrong, once."""

    def answer(request: Request) -> Outcome | None:
        if isinstance(request, ReadHoldingRegisters) and request.address == VB01:
            return Answered((word,) * request.count, at_s=rig.clock.now_s(), response_time_s=0.0)
        return None

    return once(answer)


def once(rule: Callable[[Request], Outcome | None]) -> Callable[[Request], Outcome | None]:
    left = [1]

    def one(request: Request) -> Outcome | None:
        outcome = rule(request) if left[0] else None
        left[0] -= outcome is not None
        return outcome

    return one


def refuse(kind: type[WriteCoil], code: int) -> Callable[[Request], Outcome | None]:
    return lambda request: Refused(code, at_s=0.0) if isinstance(request, kind) else None


def forget_coil_2(rig: CommandRig, request: Request) -> None:
    if isinstance(request, ReadCoils):
        rig.unit.coils[1] = False


def change_direction_bit(rig: CommandRig, request: Request) -> None:
    """Change a bit of the status word, from which the command word is built, with each reading."""
    if isinstance(request, ReadHoldingRegisters) and request.address <= 680:
        rig.unit.holding[680] ^= 0x0800


def broken(*_args: object) -> None:
    raise RuntimeError("a bug")


async def running(family: str = "ssw07") -> CommandRig:
    rig = CommandRig(family)
    await rig.online()
    if family in ("ssw06", "ssw07"):
        rig.unit.holding[VB01] = AT_SPEED
        rig.poll()
        rig.sink.clear()
    return rig
