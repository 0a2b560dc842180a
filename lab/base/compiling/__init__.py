"""Compiling: how a kernel is compiled, what its code depends on, and where it is kept."""
