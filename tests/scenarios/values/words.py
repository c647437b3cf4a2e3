"""What the tables of this folder share."""

from __future__ import annotations

from collections.abc import Iterable

from tests.rig import RigPlant
from tests.rig.rows import Action


def refuse_rows(name: str, addresses: Iterable[int], code: int = 2, *, for_s: float | None = None) -> Action:
    """Have a starter refuse each read that has one of these registers in it, with an exception code."""

    def refuse(plant: RigPlant) -> None:
        starter = plant.starter(name)
        own = starter._own
        end_s = plant.world.now_s() + (for_s if for_s is not None else 1e9)

        def handle(pdu: bytes, now_s: float) -> bytes | None:
            first, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
            is_refused = pdu[0] in (3, 4) and any(first <= each < first + count for each in addresses)
            if is_refused and plant.world.now_s() < end_s:
                return bytes((pdu[0] | 0x80, code))
            return own(pdu, now_s)

        starter._own = handle

    return refuse
