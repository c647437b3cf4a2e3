"""`demo`: a broker, simulated starters and the gateway in one terminal. Start at `demo`."""

from gateway.cli.demo.demo import add_parser, run

__all__ = ["add_parser", "run"]
