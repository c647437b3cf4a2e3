"""The simulated SSW900."""
