"""`watch`: a live table of the starters in the terminal, from MQTT alone. Start at `watch`."""

from gateway.cli.watch.watch import add_parser, run

__all__ = ["add_parser", "run"]
