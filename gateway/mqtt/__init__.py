"""Everything MQTT: what is said (`contract`), what waits for the broker (`outbox`), the connection.

Start at `publisher` for the way out and at `connection.inbox` for the way in.
"""
