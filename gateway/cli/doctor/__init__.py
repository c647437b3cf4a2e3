"""`doctor`: finds problems of the machine, the broker and the starters' settings. Start at `doctor`."""

from gateway.cli.doctor.doctor import add_parser, run

__all__ = ["add_parser", "run"]
