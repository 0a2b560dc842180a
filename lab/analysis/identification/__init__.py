"""Identification: noise, latency and lever arm from the innovations of a `Run`, most of all of a real log."""
