"""Beside: an algorithm of one's own beside the live navigator, in a process apart, and their attitudes compared."""
