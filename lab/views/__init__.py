"""Views: everything that draws: plots of the page and of notebooks, the 3-D scene, cards, files of tracks.

In: a `lab.experiment.result.Result`, a live state or a mission. Out: its drawing. A view computes no physics
and runs no server; what a plot shows is declared once, for page and notebook.

Read first: `quantities` (what can be plotted), `figures` (the plots of the page), `plots` (those of a
notebook).
"""
