"""Decoder error: a decoder cannot be had."""


class DecoderError(ValueError):
    """There is no such decoder, or one's own failed to load; the message says why and what is accepted."""
