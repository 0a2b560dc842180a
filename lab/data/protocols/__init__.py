"""Protocols: the bytes of sensors and receivers become samples, and samples become such bytes."""
