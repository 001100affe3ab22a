"""Bounded parsers that several formats share: OUTPUT4, bulk data, zipped arrays, sidecars."""
