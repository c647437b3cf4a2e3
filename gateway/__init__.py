"""Starter Gateway: motor soft-starters on RS-485 Modbus lines, published and commanded over MQTT."""

__version__ = "0.3.0"
