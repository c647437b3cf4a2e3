"""`parameters`: save, compare and restore the parameters of a starter. Start at `parameters`."""

from gateway.cli.parameters.parameters import add_parser, run

__all__ = ["add_parser", "run"]
