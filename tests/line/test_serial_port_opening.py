"""What keeps a tty from being opened, and how that is reported."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import termios
import threading

import pytest
import serial

from gateway.errors import PortError
from gateway.line.port import opener as serial_port
from gateway.line.port.opener import port_error
from gateway.modbus.timing import Framing
from tests.line.opened import LONG_S, Pty, opener, read_pty, settled
from tests.ordinary_user import give
from tests.waiting import until


async def test_reopening_waits_until_the_port_before_is_closed(pty: Pty) -> None:
    opens = opener(pty.path)
    before = len(os.listdir("/proc/self/fd"))

    for number in range(20):
        port = await opens()
        port.write(bytes((number,)))
        assert await read_pty(pty, 1) == bytes((number,))
        if number % 2:
            port.close()
    await settled(port)

    assert len(os.listdir("/proc/self/fd")) == before


async def test_a_second_opener_finds_the_port_busy(pty: Pty) -> None:
    port = await opener(pty.path)()

    with pytest.raises(PortError, match=r"busy \(another program holds it"):
        await opener(pty.path)()

    await settled(port)


def test_a_pseudo_terminal_opens_again_for_an_ordinary_user_whose_gateway_was_killed(pty: Pty) -> None:
    give(pty.path)
    command = [sys.executable, "-m", "tests.line.port_holder", pty.path]

    for _ in range(2):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "open\n"
            holder.kill()


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("/dev/serial/by-id/nowhere", "no such port (plug the adapter in"),
        ("/dev/null", "not a serial port"),
        ("/etc/hostname", "not a serial port"),
        ("socket://", "write socket://host:port"),
        ("socket://[half:1", "write socket://host:port"),
        ("rfc2217://host:1", "write socket://host:port"),
    ],
)
async def test_what_cannot_be_opened_is_reported_with_a_hint(path: str, text: str) -> None:
    with pytest.raises(PortError) as caught:
        await opener(path)()

    assert text in str(caught.value)
    assert str(caught.value).startswith(f"port {path}: ")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (PermissionError(errno.EACCES, "denied"), "add the user to group dialout"),
        (serial.SerialException(errno.EBUSY, "busy"), "another program holds it"),
        (OSError(errno.EIO, "io"), "unplug the adapter"),
        (termios.error(errno.ENOTTY, "no tty"), "not a serial port"),
        (ValueError("Invalid baud rate: 7"), "Invalid baud rate: 7"),
    ],
)
def test_errors_of_the_system_are_reported_in_a_users_words(error: Exception, text: str) -> None:
    assert text in str(port_error("/dev/ttyUSB0", error))


async def test_a_descriptor_that_select_cannot_serve_is_refused(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_port, "_SELECT_LIMIT", 3)
    before = len(os.listdir("/proc/self/fd"))

    with pytest.raises(PortError, match="too many open files"):
        await opener(pty.path)()

    assert len(os.listdir("/proc/self/fd")) == before


async def test_a_tty_that_does_not_open_in_time_is_given_up_and_closed_when_it_does(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    opens = opener(pty.path)
    may_open = threading.Event()
    open_device = opens._open_device
    opened: list[serial.Serial] = []

    def open_late() -> serial.Serial:
        may_open.wait(LONG_S)
        opened.append(open_device())
        return opened[0]

    monkeypatch.setattr(opens, "_open_device", open_late)
    monkeypatch.setattr(serial_port, "OPEN_LIMIT_S", 0.01)

    with pytest.raises(PortError, match="does not open within"):
        await opens()
    may_open.set()
    await until(lambda: bool(opened) and not opened[0].is_open)


@pytest.mark.parametrize("framing", ["8N1", "8N2", "8E1", "8O1"])
async def test_rate_and_framing_are_set_and_the_control_lines_left_low(
    pty: Pty, framing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Framing.parse(framing)
    monkeypatch.setattr(serial_port, "_PSEUDO_TERMINALS", ())

    device = opener(pty.path, 9600, asked)._open_device()

    assert device.baudrate == 9600
    assert device.parity == asked.parity
    assert device.stopbits == asked.stop_bits
    assert not device.rts
    assert not device.dtr
    attributes = termios.tcgetattr(device.fileno())
    assert bool(attributes[2] & termios.CSTOPB) == (asked.stop_bits == 2)
    assert attributes[4] == termios.B9600
    device.close()
