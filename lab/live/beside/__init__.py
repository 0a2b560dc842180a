"""Beside: algorithms of one's own beside the live navigator, in processes apart, and attitudes compared."""
