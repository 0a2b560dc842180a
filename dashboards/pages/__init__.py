"""Pages: what a session shows of its result, one module for each kind."""
