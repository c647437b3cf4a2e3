"""What the gateway needs of the machine it runs on: its clocks. Start reading in `clock_steps.py`."""
