"""`report`: how a motor and its starter do, for the terminal or as a page to print. Start at `report`."""

from gateway.cli.report.report import add_parser, run

__all__ = ["add_parser", "run"]
