"""One RS-485 line: who is asked what and when, and what came of it.

Start at `service`, the loop on an open port. `scheduler` decides, `rtu` does one transaction, `port` handles
bytes, `capacity` computes what a line can serve. `thread` runs all lines beside the application.
"""
