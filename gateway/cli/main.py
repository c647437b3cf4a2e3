"""The command line: runs a command, and reports its error as one line and an exit code."""

from __future__ import annotations

# PYTHON_ARGCOMPLETE_OK
import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn, cast

from gateway import __version__
from gateway.cli.command import CommandModule, choose
from gateway.errors import ConfigError, GatewayError, NewerError, UsageError

PROGRAM = "starter-gateway"
DONE, FAILED, USAGE, BAD_CONFIG = 0, 1, 2, 78  # 78 is EX_CONFIG of sysexits.h

COMMANDS = {
    "run": "run the gateway of a configuration",
    "demo": "run simulated starters, a broker and the gateway on this machine",
    "check": "validate a configuration and print the budget of its lines",
    "simulate": "simulate the starters of a configuration on pseudo-terminals",
    "scan": "find and identify the starters on a port, by reads only",
    "doctor": "look for problems of this machine and in these starters' settings",
    "parameters": "save, compare and restore the parameters of a starter",
    "send": "send a command over MQTT and show its result",
    "watch": "show the starters as a live table, from MQTT alone",
    "report": "print the health of a motor and its starter, or write it as a page",
    "history": "list recorded starts and trips, export one as CSV or COMTRADE",
    "audit": "show or verify the record of commands",
    "capture": "record a running gateway's lines for Wireshark",
    "decode": "decode words read from a starter",
    "encode": "print the frames that a command would send",
    "schema": "print the JSON Schema of the configuration",
    "backup": "store configuration and state of a gateway in one file",
    "restore": "put back a backup, or the files from before an upgrade",
    "docs": "serve this program's documentation on loopback",
    "broker-kit": "write the files of a Mosquitto for this gateway, and prove them on the running broker",
    "web-password": "print the line of a login of the status page",
}
EXAMPLES = {
    "scan": "scan /dev/rs485-pumps --baud 19200 --framing 8E1 --address 1-16",
    "doctor": "doctor site.toml --username alice",
    "parameters": "parameters save site.toml pump-1 pump-1.toml --username alice",
    "send": "send site.toml pump-1 start expect=state:ready --client alice --username alice",
    "watch": "watch site.toml --username alice",
    "report": "report site.toml pump-1 --html pump-1.html --username alice",
    "history": "history site.toml pump-1 --csv -",
    "audit": "audit show site.toml --last 20",
    "decode": "decode ssw07 holding P003 815",
    "encode": "encode ssw07 1 set parameter=P314 value=30",
    "backup": "backup site.toml mcc1.tar.gz",
    "restore": "restore mcc1.tar.gz --to /tmp/look",
    "broker-kit": "broker-kit site.toml broker-kit --host broker.plant",
}
_HOMES = {"simulate": "demo", "backup": "restore", "history": "report"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    chosen = next((word for word in arguments if word in COMMANDS), None)
    unknown = next((word for word in arguments if chosen is None and not word.startswith("-")), None)
    if unknown is not None:
        print(f"{PROGRAM}: no command {unknown!r} ({choose(unknown, COMMANDS)})", file=sys.stderr)
        return USAGE
    if "_ARGCOMPLETE" in os.environ:
        with suppress(ImportError):  # an optional extra
            import argcomplete

            argcomplete.autocomplete(whole_parser())
    try:
        args = _parse(_parser(chosen), arguments)
    except SystemExit as leaving:  # argparse has said why: help, version or a wrong word
        return int(leaving.code or DONE)
    try:
        code = _load(args.command).run(args)
        print(end="", flush=True)  # nothing where there is no output at all
    except GatewayError as error:
        for line in str(error).splitlines():
            print(f"{PROGRAM}: {line}", file=sys.stderr)
        return _exit_code(error)
    except BrokenPipeError:  # the reader of our output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        return FAILED
    return code


class _Parser(argparse.ArgumentParser):
    """Reports a usage error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(USAGE, f"{PROGRAM}: {message} (see {self.prog} --help)\n")


class _Help(argparse.HelpFormatter):
    """Keeps each command on one line; argparse forgets that they stand two columns further in."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = 4 + max(map(len, COMMANDS))


def whole_parser() -> argparse.ArgumentParser:
    """Return a parser that knows the arguments of every command: for completion, and for the manual page."""
    return _parser(None, is_whole=True)


def _parser(chosen: str | None, *, is_whole: bool = False) -> argparse.ArgumentParser:
    """Return a parser that knows the chosen command's arguments; the other commands are not even imported."""
    parser = _Parser(
        prog=PROGRAM,
        description="Gateway between soft-starters on RS-485 lines and MQTT. It is not a safety function.",
        epilog="exit codes: 0 done, 1 failed, 2 usage, 75 not now (check --upgrade), 78 bad configuration, "
        "or a state of a later version",
        formatter_class=_Help,
    )
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, about in COMMANDS.items():
        example = f"example: {PROGRAM} {EXAMPLES[name]}" if name in EXAMPLES else None
        its_own = subparsers.add_parser(name, help=about, epilog=example)
        if name == chosen or is_whole:
            command = _load(name)
            its_own.description = " ".join((command.__doc__ or "").partition("\n\n")[0].split())
            command.add_arguments(its_own)
    return parser


def _parse(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    """Return the parsed arguments; KEY=VALUE words may follow an option too, which argparse forbids."""
    args, left = parser.parse_known_args(arguments)
    if left and (not hasattr(args, "args") or any(word.startswith("-") for word in left)):
        parser.prog = f"{PROGRAM} {args.command}"  # whose help names what it takes
        parser.error(f"unrecognized arguments: {' '.join(left)}")
    if left:
        args.args += left
    return args


def _load(name: str) -> CommandModule:
    """Return a command's module: of its name, in this folder, one of that name or another command's."""
    module = name.replace("-", "_")
    home = _HOMES.get(name, module)
    folder = f".{home}" if (Path(__file__).parent / home).is_dir() else ""
    return cast(CommandModule, importlib.import_module(f"gateway.cli{folder}.{module}"))


def _exit_code(error: GatewayError) -> int:
    if isinstance(error, ConfigError | NewerError):
        return BAD_CONFIG
    return USAGE if isinstance(error, UsageError) else FAILED
