"""flexplant."""
