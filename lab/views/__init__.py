"""Views: what a plot shows, declared once, and its drawings: figures of the page, notebook plots, 3-D scene.

A view takes a `lab.result.Result` and draws it; it computes no physics and serves nothing.
"""
