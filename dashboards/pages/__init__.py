"""Pages: the views of a session's result, one module for each."""
