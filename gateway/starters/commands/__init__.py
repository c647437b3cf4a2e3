"""The life of a command: admission, readings, one write, read-back, result.

Start at `dispatcher`; `execution` is the ordinary way, `stop` the one of stops.
"""
