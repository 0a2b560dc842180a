"""Upstream: the private parts of Bokeh, Panel and viser that the laboratory replaces or reads.

`upstream.js` replaces those in the browser; all others are on the server. No file elsewhere uses private
parts of these libraries (`tests/test_private_parts.py`). Each part is tested against the installed version,
which `pyproject.toml` pins (`tests/dashboards/test_upstream.py`, `tests/dashboards/test_patch_messages.py`).

These upstream changes would make parts unnecessary:

- Lazily computed defaults, and one description of properties for each class: Bokeh 4, issue `bokeh#15354
  <https://github.com/bokeh/bokeh/issues/15354>`_, and for 3.10 pull request ``bokeh#15322``.
- An ended document without reference cycles: ``bokeh#11523``, open since 2021. Collections that block all
  sessions: ``panel#3259``.
- Events without the lock of their document: no upstream issue is known. They carry the mark of
  `panel.io.with_lock`.
- Panel's repeated copies, lookups and searches for each component, values of the server that its components
  send back, and access control in viser: no upstream issue is known.
"""
