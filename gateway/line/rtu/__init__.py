"""Modbus RTU on one line: requests, replies and what can be mistaken for a reply.

Start with `late_replies`: when a reply may still come, and which request may be sent meanwhile.
"""
