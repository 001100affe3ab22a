"""Responses of plants: frequency, norms, margins, time."""
