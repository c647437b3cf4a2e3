"""Starter Gateway: motor soft-starters on RS-485 Modbus lines, published and commanded over MQTT."""

from pathlib import Path

from gateway.system.version import commit_mark

__version__ = "0.3.0"
__version__ += commit_mark(Path(__file__).parent, __version__)
