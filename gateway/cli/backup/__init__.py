"""`backup`: configuration and state of a gateway in one file. Start at `backup`."""

from gateway.cli.backup.backup import add_parser, run

__all__ = ["add_parser", "run"]
