"""`history`: the recorded starts and trips of a starter, listed or exported. Start at `history`."""

from gateway.cli.history.history import add_parser, run

__all__ = ["add_parser", "run"]
