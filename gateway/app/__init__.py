"""The running gateway: built of the other packages, started, reloaded and ended here.

Start at `gateway`, the composition root; `plant` holds the lines and starters, `uplink` the broker.
"""
