"""What is kept of the bytes on a virtual line: frames, and what the master did wrong."""

from __future__ import annotations

from dataclasses import dataclass, field

from gateway.modbus.timing import LineTiming


@dataclass(frozen=True, slots=True)
class Frame:
    """Bytes that were on the line without a longer silence between them."""

    start_s: float
    end_s: float
    sender: int  # 0 = master, else the unit's address
    data: bytes
    note: str = ""

    def __str__(self) -> str:
        arrow = "<<" if self.sender else ">>"
        note = f"  ({self.note})" if self.note else ""
        return f"{self.start_s:.4f} {arrow} {self.data.hex(' ').upper()}{note}"


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that the master must not do on a serial line."""

    at_s: float
    kind: str  # early, collision, broken, turnaround
    detail: str

    def __str__(self) -> str:
        return f"{self.at_s:.4f} {self.kind}: {self.detail}"


@dataclass(slots=True)
class IncomingFrame:
    """A frame of the master as it grows; a silence ends it."""

    timing: LineTiming
    start_s: float
    end_s: float
    data: bytearray = field(default_factory=bytearray)
    longest_gap_s: float = 0.0
    spoilt: str = ""  # why nobody can understand it

    def extend(self, data: bytes, *, start_s: float) -> None:
        """Add bytes that follow on."""
        self.longest_gap_s = max(self.longest_gap_s, start_s - self.end_s)
        self.data += data
        self.end_s = start_s + self.timing.wire_s(len(data))
