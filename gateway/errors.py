"""Every exception of the gateway, split by what the caller does next.

GatewayError
├── ConfigError          the configuration is wrong: print all problems, exit 78
├── UsageError           a command line asks for what does not exist: exit 2
├── StartError           another gateway runs, or this user may not: exit 1
├── PortError            the port cannot be opened (now): report, wait, retry
│   └── PortLostError    an open port is gone: report, reopen
│       └── PortResetError  we have reset a connection, so that nothing in it acts late: reopen at once
├── CodecError           bytes that are no valid Modbus: `transaction` converts it to an outcome
│   ├── BadFrameError    wrong CRC, too short, too long
│   ├── BadReplyError    a valid frame that does not answer this request
│   └── BadRequestError  a request that no starter could accept; the simulator answers an exception
├── CommandError         a command that cannot be carried out as asked, with a code: in gateway/contract
├── StoreError           nothing can be stored on the disk (now): report, continue without, retry
│   ├── DamagedError     the file is not what was written: set it aside, begin with a new one
│   └── NewerError       a later version has written the file: leave it as it is, exit 78
├── BrokerError          the broker refuses or is away: report, wait, retry
├── CaptureError         a running gateway's lines cannot be recorded: exit 1
└── NoResultError        a command was sent and its end is unknown: look at the starter
"""

from __future__ import annotations

from dataclasses import dataclass


class GatewayError(Exception):
    """Root of all exceptions that this package raises on purpose; `hint` is the remedy, in the text too."""

    def __init__(self, text: str = "", hint: str = "") -> None:
        super().__init__(f"{text} ({hint})" if hint else text)


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a file: where it is, what is wrong and how to correct it."""

    key: str  # dotted path, e.g. line[0].starter[2].address
    what: str
    hint: str = ""
    line: int | None = None  # 1-based line in the file

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line is not None else ""
        hint = f" ({self.hint})" if self.hint else ""
        return f"{where}{self.key}: {self.what}{hint}"


class ConfigError(GatewayError):
    """The configuration is wrong; carries every problem at once."""

    def __init__(self, path: str, problems: list[Problem]) -> None:
        self.path = path
        self.problems = problems
        super().__init__("\n".join(f"{path}: {problem}" for problem in problems))


class UsageError(GatewayError):
    """A command line asks for something that does not exist."""


class StartError(GatewayError):
    """The gateway must not run here now: another one does, or its user may not write where it has to."""


class PortError(GatewayError):
    """A port cannot be opened: missing, busy, not permitted, not a tty."""

    def __init__(self, port: str, reason: str, hint: str = "") -> None:
        self.reason = reason
        super().__init__(f"port {port}: {reason}", hint)


class PortLostError(PortError):
    """An open port has gone: unplugged, hung up, read error."""


class PortResetError(PortLostError):
    """A connection that was reset on purpose: what was still under way in it must not arrive later."""


class CodecError(GatewayError):
    """Bytes that are no valid Modbus."""


class BadFrameError(CodecError):
    """A frame with a wrong CRC or an impossible length [SERIAL 2.5.1]."""


class BadReplyError(CodecError):
    """A valid frame that is not the reply to this request."""


class BadRequestError(CodecError):
    """A request PDU that no Modbus server could accept; `exception_code` is what a server answers."""

    def __init__(self, reason: str, exception_code: int) -> None:
        self.exception_code = exception_code
        super().__init__(reason)


class StoreError(GatewayError):
    """Nothing can be stored on the disk (now)."""


class DamagedError(StoreError):
    """What is on the disk is not what was written there."""


class NewerError(StoreError):
    """A file has the format of a later version of this program; one line for each such file."""


class BrokerError(GatewayError):
    """The broker refused the connection or cannot be reached."""


class NoResultError(GatewayError):
    """A command was sent, and its final result did not come; with its `id` it can be asked for again."""

    def __init__(self, id_: str, text: str) -> None:
        self.id = id_
        super().__init__(text)


class CaptureError(GatewayError):
    """A running gateway's lines cannot be recorded."""
