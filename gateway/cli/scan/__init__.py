"""`scan`: which starters answer on a port, with which rate and framing. Start at `scan`."""

from gateway.cli.scan.scan import add_parser, run

__all__ = ["add_parser", "run"]
