"""Modbus PDUs and RTU frames; pure. Start at `pdu` and `adu`."""
