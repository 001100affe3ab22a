"""Readers, one file a format: each module here that defines `FORMAT` is in the registry."""
