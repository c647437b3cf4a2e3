"""The systemd interface: readiness, status and watchdog [sd_notify(3)], and log priorities."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Mapping
from typing import IO

# sd-daemon(3): a line of stderr that begins with <n> is logged at syslog's priority n.
_PRIORITIES = (
    (logging.CRITICAL, 2),
    (logging.ERROR, 3),
    (logging.WARNING, 4),
    (logging.INFO, 6),
    (logging.DEBUG, 7),
)


class Notifier:
    """Sends the service's state to systemd [sd_notify(3)]; without systemd it does nothing.

    A lost message is not an error: the service runs on, and systemd's own time limits decide.
    """

    def __init__(self, environ: Mapping[str, str]) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address

    def ready(self, status: str = "") -> None:
        """Report that the service is up: the configuration is loaded and the lines are polled."""
        self._send("READY=1", status)

    def reloading(self) -> None:
        """Report that the configuration is read again; `ready` ends it."""
        now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self._send(f"RELOADING=1\nMONOTONIC_USEC={now_us}")

    def stopping(self, status: str = "") -> None:
        """Report that the service is ending."""
        self._send("STOPPING=1", status)

    def status(self, text: str) -> None:
        """Show one line in `systemctl status`."""
        self._send("", text)

    def watchdog(self) -> None:
        """Feed the service watchdog; call it only when every loop has moved."""
        self._send("WATCHDOG=1")

    def _send(self, message: str, status: str = "") -> None:
        if not self._address:
            return
        if status:
            message += "\nSTATUS=" + status.replace("\n", " ")
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
                sender.sendto(message.strip().encode(), socket.MSG_DONTWAIT, self._address)
        except OSError as error:
            logging.getLogger(__name__).debug("systemd was not notified: %s", error)


def watchdog_interval_s(environ: Mapping[str, str]) -> float | None:
    """Return how often to call `Notifier.watchdog`, half of systemd's limit; None when it is off."""
    limit = environ.get("WATCHDOG_USEC", "")
    pid = environ.get("WATCHDOG_PID", "")
    if not limit.isdecimal() or int(limit) == 0 or (pid and pid != str(os.getpid())):
        return None
    return int(limit) / 2e6


def is_journal(environ: Mapping[str, str], stream: IO[str]) -> bool:
    """Return whether the stream goes straight to the journal [systemd.exec(5), JOURNAL_STREAM]."""
    device, _, inode = environ.get("JOURNAL_STREAM", "").partition(":")
    try:
        status = os.fstat(stream.fileno())
    except OSError:  # no file behind it
        return False
    return (device, inode) == (str(status.st_dev), str(status.st_ino))


class PriorityFormatter(logging.Formatter):
    """Marks every line with its priority; the journal adds the time itself."""

    def __init__(self) -> None:
        super().__init__("%(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Return the record's lines, each with its mark: the journal takes lines one by one."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())
