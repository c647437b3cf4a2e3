"""`restore`: what a backup holds, or the files of before an upgrade, put back. Start at `restore`."""

from gateway.cli.restore.restore import add_parser, run

__all__ = ["add_parser", "run"]
