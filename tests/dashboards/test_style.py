"""Colours of the page: letters on buttons can be read."""

from __future__ import annotations

import re

import numpy as np

from dashboards.style import THEME
from dashboards.teaching.bar_style import BAR

LEAST = 4.5
"""Least contrast of letters and their ground: WCAG 2, success criterion 1.4.3."""


def over(text: str, ground: np.ndarray) -> np.ndarray:
    """Return red, green and blue, from 0 to 1, of a colour painted over another."""
    if text.startswith("#"):
        return np.array([int(text[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    *colour, alpha = (float(part) for part in re.findall(r"\d*\.?\d+", text))
    return alpha * np.array(colour) / 255 + (1 - alpha) * ground


def luminance(colour: np.ndarray) -> float:
    """Return the relative luminance of WCAG 2."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(letters: str, ground: str) -> float:
    """Return the contrast of letters on an opaque ground."""
    below = over(ground, np.ones(3))
    light, dark = sorted((luminance(over(letters, below)), luminance(below)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_letters_on_grey_buttons_can_be_read() -> None:
    """The library's own greys have 4.2 under the mouse."""
    assert abs(contrast("#757575", "#f5f5f5") - 4.23) < 0.01  # as the browser's inspector says
    palette = THEME["light"]["palette"]
    grey = palette["default"]
    assert contrast(grey["dark"], grey["light"]) >= LEAST  # a button under the mouse
    assert contrast(grey["main"], palette["background"]["default"]) >= LEAST
    assert contrast(palette["action"]["active"], grey["light"]) >= LEAST  # one of several that is not chosen


def test_a_button_that_is_pressed_can_be_read_in_the_line_of_a_class() -> None:
    primary = THEME["light"]["palette"]["primary"]["main"]
    (tint,) = re.findall(r"background: (rgba\(.*?\))", BAR)
    line = over(tint, np.ones(3))
    pressed = 0.08 * over(primary, line) + 0.92 * line  # as the library paints it
    light, dark = luminance(pressed), luminance(over(primary, line))
    assert (light + 0.05) / (dark + 0.05) >= LEAST
