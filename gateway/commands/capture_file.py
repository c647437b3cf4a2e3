"""Frames in a pcapng file; the only module that knows python-pcapng.

The link type is that of serial lines recorded by an RTAC: it says who spoke, and Wireshark can hand the bytes
over to its Modbus RTU dissector (LINKTYPE_RTAC_SERIAL, Wireshark's packet-rtacser.c).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

from gateway.errors import CaptureError

LINKTYPE_RTAC_SERIAL = 250
READ_WITH = "-d rtacser.data,mbrtu -o mbrtu.crc_verification:TRUE"  # what Wireshark and tshark need

_DATA_TX_START, _DATA_RX_END = 0x01, 0x04
_HEADER = ">IIBBH"  # seconds, microseconds, event, control lines, footer
_MICROSECONDS = 1_000_000


class CaptureFile:
    """Writes one interface for each line; the file is whole after every frame."""

    def __init__(self, path: Path, lines: Iterable[str]) -> None:
        try:
            from pcapng import FileWriter, blocks
        except ImportError as error:
            raise CaptureError("python-pcapng is missing (pip install 'starter-gateway[capture]')") from error
        section = blocks.SectionHeader(options={"shb_userappl": "starter-gateway"})
        self._interfaces: dict[str, int] = {}
        for number, line in enumerate(lines):
            section.new_member(
                blocks.InterfaceDescription,
                link_type=LINKTYPE_RTAC_SERIAL,
                options={"if_name": line, "if_description": "Modbus RTU"},
            )
            self._interfaces[line] = number
        self._packet = blocks.EnhancedPacket
        self._section: Any = section
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise CaptureError(f"{path}: {error.strerror}") from error
        self._writer = FileWriter(self._file, section)

    def write(self, line: str, time_us: int, direction: str, frame: bytes) -> None:
        """Append a frame: >> began then, anything else ended then."""
        event = _DATA_TX_START if direction == ">>" else _DATA_RX_END
        seconds, microseconds = divmod(time_us, _MICROSECONDS)
        data = struct.pack(_HEADER, seconds, microseconds, event, 0, 0) + frame
        self._writer.write_block(
            self._section.new_member(
                self._packet,
                interface_id=self._interfaces[line],
                timestamp_high=time_us >> 32,
                timestamp_low=time_us & 0xFFFF_FFFF,
                packet_len=len(data),
                captured_len=len(data),
                packet_data=data,
            )
        )
        self._file.flush()

    def __enter__(self) -> CaptureFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._file.close()
