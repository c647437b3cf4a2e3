"""What happened to a motor: pure recorders that make records of its starts and trips, and count.

Start reading at `start_recorder.py` (readings in, a finished record out) and `baseline.py` (is it still as it
was), at `trip_recorder.py` (what came before a trip), and at `counters.py` (what adds up).
`gateway.plugins.history.service` feeds them and stores what they give.
"""
