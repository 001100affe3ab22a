"""Makes the small structures of `structures.py` importable from every room of tests."""
