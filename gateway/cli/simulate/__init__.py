"""`simulate`: simulated starters on pseudo terminals or TCP. Start at `simulate`."""

from gateway.cli.simulate.simulate import add_parser, run

__all__ = ["add_parser", "run"]
