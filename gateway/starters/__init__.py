"""Starters: their values, commands and rules, whatever their family. `setup` is a starter as configured.

Start at `telemetry.telemetry` for what is read, and at `commands.dispatcher` for what is commanded.
"""
