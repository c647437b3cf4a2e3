"""From the line's outcomes to records: snapshot, state, alarms, report by exception.

Start at `telemetry`; `polling` says what is read, `reporting` what is published.
"""
