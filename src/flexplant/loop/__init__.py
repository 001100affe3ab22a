"""Wiring plants and blocks into loops, and running them: in frequency, in time, at steady state."""
