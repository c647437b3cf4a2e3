"""What is done for each starter in the background, beside its polls. Start at `services`."""
