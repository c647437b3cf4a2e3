"""`broker-kit`: what a Mosquitto needs for this gateway, and the proof of it. Start at `broker_kit`."""

from gateway.cli.broker_kit.broker_kit import add_parser, run

__all__ = ["add_parser", "run"]
