"""The world outside a gateway: its ports, its threads, the kernel's clock, the page's socket.

`run` uses the machine's. A test hands in another world, and needs to know nothing else of the gateway.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gateway.line import PortOpener, SerialOpener
from gateway.modbus import LineTiming
from gateway.system.clock import is_kernel_clock_synchronised


def serial_opener(port: str, timing: LineTiming) -> PortOpener:
    """Return what opens a tty or a serial server."""
    return SerialOpener(port, timing.baud, timing.framing)


@dataclass(frozen=True, slots=True, kw_only=True)
class Io:
    """What a gateway reaches the world through; the defaults are this machine."""

    make_opener: Callable[[str, LineTiming], PortOpener] = serial_opener  # of a port by its name
    has_line_thread: bool = True  # else the lines share the gateway's loop
    is_clock_synchronised: Callable[[], bool] = is_kernel_clock_synchronised
    make_web_server: Callable[..., Any] | None = None  # None: `gateway.plugins.web.server.Server`


MACHINE = Io()  # what commands use that open ports themselves
