"""Equal scale: a metre is as long along both axes, however wide the window.

Bokeh's ``match_aspect`` holds for automatic ranges only. The browser alone knows the size of a frame, so it
widens one of the two ranges.
"""

from __future__ import annotations

from bokeh.models.callbacks import CustomJS
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure

WIDEN = """
let width, height;
try { width = fig.inner_width; height = fig.inner_height; } catch { return; }  // it is not laid out yet
if (!(width > 0 && height > 0)) return;
const now = () => [x.start, x.end, y.start, y.end].join();
const state = fig.equal_scale ??= {};
if (state.set !== now()) state.wanted = [x.start, x.end, y.start, y.end];  // others have set them
const [left, right, low, high] = state.wanted;
const scale = Math.max((right - left) / width, (high - low) / height);  // metres of a pixel
const wider = (scale * width - (right - left)) / 2, higher = (scale * height - (high - low)) / 2;
const ends = [left - wider, right + wider, low - higher, high + higher];
if (ends.join() === now()) return;
state.set = ends.join();
x.setv({start: ends[0], end: ends[1]}, {sync: false});
y.setv({start: ends[2], end: ends[3]}, {sync: false});
"""
"""Widens the shorter range about its middle; what the server or a person has set is shown whole."""


def keep_equal(fig: figure, x: Range1d, y: Range1d, source: ColumnDataSource) -> None:
    """Keep the scales of both axes equal in the browser.

    Parameters
    ----------
    fig
        The figure.
    x, y
        Its ranges.
    source
        Data that change often: the scales are looked at with them, since a window may change its size.
    """
    widen = CustomJS(args={"fig": fig, "x": x, "y": y}, code=WIDEN)
    source.js_on_change("data", widen)
    y.js_on_change("end", widen)
