"""What the gateway needs of the machine it runs on, and nothing else knows of: start with `instance_lock`."""
