"""Simulated starters, for the demo, `simulate` and the tests; `run` never imports them.

Start at `factory`, which makes one of any family, and at `core.unit`, what they all have; `weg`, `ssw900` and
`sst` are the families, `bus` is the line between them and a gateway.
"""
