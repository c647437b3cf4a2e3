"""What the gateway needs of the operating system, and nothing else knows of: start with `instance_lock`."""
