"""Repeatable control inside other people's programs; each module needs its own extra."""
