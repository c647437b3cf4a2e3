"""The past of a motor: records of its starts and trips, counters and limits.

Start reading at `plugin.py`, which feeds, stores and publishes. The rules are pure: `start_recorder.py` and
`trip_recorder.py` (readings in, a finished record out), `baseline.py` (does the motor start as it did),
`counters.py` (what adds up) and `limits.py` (what must be waited for).
"""
