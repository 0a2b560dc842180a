"""Views: the content of each plot, declared once, and its drawings: page, notebook, 3-D scene.

A view takes a `lab.result.Result` and draws it; it computes no physics and runs no server.
"""
