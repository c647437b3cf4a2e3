"""`broker-kit`: what a Mosquitto needs for this gateway, and the proof of it. Start at `broker_kit`."""
