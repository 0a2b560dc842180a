"""Style: colours and dimensions of the page, and the columns and rows that its parts stand in."""

from __future__ import annotations

from typing import Any

import panel as pn
import panel_material_ui as pmui

_FIELDS: dict[str, Any] = {
    "MuiSelect": {
        "styleOverrides": {
            "select": {"&&": {"paddingTop": "8.5px", "paddingBottom": "8.5px", "minHeight": "23px"}}
        }
    }
}
"""Selects are as high as text fields, which stand beside them in rows."""
_NAMED: dict[str, Any] = {"MuiLinearProgress": {"defaultProps": {"aria-label": "Progress"}}}
"""Parts whose name readers of the screen need, and the library gives none."""
_CHOSEN: dict[str, Any] = {"backgroundColor": "Highlight", "color": "HighlightText"}
_CONTRAST: dict[str, Any] = {
    name: {"styleOverrides": {part: {"@media (forced-colors: active)": style}}}
    for name, part, style in (
        ("MuiTabs", "indicator", _CHOSEN),
        ("MuiToggleButton", "root", {"&.Mui-selected": {**_CHOSEN, "forcedColorAdjust": "none"}}),
    )
}
"""What is chosen is seen, too, where the reader's system replaces all colours by a few."""
_WORDS: dict[str, Any] = {"button": {"textTransform": "none"}}
"""Buttons and tabs say their words as they are written: units and names have their own capitals."""
_BRIGHT_ICONS: dict[str, Any] = {
    "MuiIconButton": {
        "styleOverrides": {
            "root": {
                "variants": [{"props": {"color": "default"}, "style": {"color": "rgba(255, 255, 255, 0.7)"}}]
            }
        }
    }
}
"""Icons that are buttons, such as those that open the groups of settings, can be seen on dark ground."""

THEME: dict[str, Any] = {
    "light": {
        "palette": {
            "primary": {"main": "#1b62b9"},
            "default": {"main": "#000000", "light": "#f5f5f5", "dark": "#616161"},
            "action": {"active": "rgba(0, 0, 0, 0.62)"},
            "background": {"default": "#f5f7fa", "paper": "#ffffff"},
            "contrastThreshold": 4.5,
        },
        "shape": {"borderRadius": 6},
        "typography": _WORDS,
        "components": _FIELDS | _NAMED | _CONTRAST,
    },
    "dark": {
        "palette": {
            "primary": {"main": "#5aa2f2", "dark": "#7fb8f6"},
            "error": {"main": "#f44336", "dark": "#f6695e"},
            "background": {"default": "#12151a", "paper": "#181c22"},
            "contrastThreshold": 4.5,
        },
        "shape": {"borderRadius": 6},
        "typography": _WORDS,
        "components": _FIELDS | _NAMED | _CONTRAST | _BRIGHT_ICONS,
    },
}
"""Colours of the two themes.

Letters on a button have a contrast of 4.5, as WCAG 2 wants, also on grey ones and under the mouse. In the
dark theme letters on coloured buttons are dark, so a button under the mouse gets lighter.
"""

HEADER, TWO_ROWS = "max(48px, 3rem)", "max(88px, 5.5rem)"
"""Heights of the header, and of its two rows on a phone; both grow with the letters of a browser."""
BESIDE_MISSION = "max(170px, 10.6rem)"
"""Width in the first row on a phone of what stands beside the mission: menu, name of the lab, and theme."""

DRESS: dict[str, Any] = {
    "& .MuiAppBar-root": {"backgroundColor": "#16324f", "backgroundImage": "none", "boxShadow": "none"},
    "& .MuiAppBar-root .MuiIconButton-root": {"color": "#ffffff"},
    "& .MuiToolbar-root": {"minHeight": f"{HEADER} !important"},
    "& .MuiToolbar-root h3, & .MuiToolbar-root .title": {"fontSize": "1.1rem", "whiteSpace": "nowrap"},
    "@media (max-width: 480px)": {
        "& .MuiToolbar-root": {"minHeight": f"{TWO_ROWS} !important"},
        "& .MuiAppBar-root .MuiToolbar-root": {
            "flexWrap": "wrap", "alignContent": "center", "height": TWO_ROWS, "padding": "0 6px"
        },
        "& .MuiAppBar-root .MuiToolbar-root > .MuiBox-root:last-of-type": {"display": "contents"},
        "& .MuiAppBar-root .MuiToolbar-root > button:last-child": {"order": 1},
        "& .child-wrapper > :not(.mission)": {"order": 2},
        "& .child-wrapper > .mission": {
            "flex": f"1 1 calc(100vw - {BESIDE_MISSION}) !important", "minWidth": 0
        },
    },
    "@media print": {
        "&, & .main, & .main > div, & .main-content": {
            "display": "block !important", "width": "auto !important", "height": "auto !important",
            "maxWidth": "none !important", "margin": "0 !important", "overflow": "visible !important",
        },
        "& .header, & nav, & .main .MuiToolbar-root": {"display": "none !important"},
    },
}  # fmt: skip
"""A flat, dark header, of two rows on a phone; paper has neither header nor settings."""

FRAME = f"""
:host {{ display: flex !important; flex-direction: column; overflow: hidden; position: relative;
        height: calc(100vh - {HEADER}) !important; min-height: 0 !important; min-width: 0 !important; }}
@media (max-width: 480px) {{ :host {{ height: calc(100vh - {TWO_ROWS}) !important; }} }}
@media print {{
  :host {{ display: block !important; overflow: visible; height: auto !important; max-width: none !important;
          width: var(--print-width, 100%) !important; zoom: var(--print-zoom, 1); }}
}}
"""
"""All below the header: tabs, message, page and time bar share the height of the window.

Panel requests the height of all plots if they exist before the frame.
"""

ON_SCREEN = "@media print { :host { display: none !important; } }"
"""What is of no use on paper."""

STAGE = """
:host { flex: 1 1 0 !important; min-height: 0 !important; min-width: 0 !important;
        overflow: hidden auto !important; container: stage / inline-size; position: relative; }
.covered { visibility: hidden; opacity: 0; transition: visibility 0s 60ms; }
.frame { position: absolute; left: 0; right: 0; padding: 20px 28px;
         font: 14px/1.5 Roboto, Arial, sans-serif; }
.frame h2 { margin: 0; font-size: 18px; font-weight: 500; }
.frame p { margin: 4px 0 12px; opacity: .75; }
.frame .bar { position: relative; height: 4px; max-width: 480px; overflow: hidden; border-radius: 2px;
              background: rgba(128, 128, 128, .25); }
.frame .bar::before { content: ""; position: absolute; inset: 0; width: 30%; background: #3b8eea;
                      animation: runs 1.6s linear infinite; }
@keyframes runs { from { transform: translateX(-100%); } to { transform: translateX(340%); } }
@media (prefers-reduced-motion: reduce) { .frame .bar::before { animation: none; } }
.frame button { margin-top: 14px; padding: 4px 14px; border: 1px solid currentColor; border-radius: 4px;
                background: none; color: inherit; font: inherit; cursor: pointer; }
.frame button:focus-visible { outline: 2px solid #3b8eea; outline-offset: 2px; }
@media print { :host { height: auto !important; overflow: visible !important; } }
"""
"""The page, which scrolls if it is higher than its place.

What the next page will replace is transparent, too: Panel makes texts visible in what is hidden. It is hidden
once the browser has painted what covers it, because then each of its elements gets a new style.
"""

WRAP = """
:host { flex-wrap: wrap; }
:host > :last-child { flex: 1 1 260px; }
"""
"""A selection and the text about it: one below the other if they do not fit side by side."""

WHOLE = ":host { max-height: none !important; min-width: 0 !important; }"
"""Makes a column as high as its content; otherwise Panel lets content higher than the window overlap."""

HIDDEN_LABEL = """
.MuiInputLabel-root, .MuiFormLabel-root { position: absolute !important; width: 1px; height: 1px;
                                          overflow: hidden; clip-path: inset(50%); }
label + .MuiInput-root { margin-top: 0 !important; }
fieldset { top: 0 !important; }
legend { display: none !important; }
"""
"""The label of a field is for readers of the screen alone: what stands beside it says the same."""

TOOLTIP = ".MuiTooltip-tooltip { width: max-content; max-width: 280px; }"
"""The tooltip of an icon button; otherwise it would be as narrow as the button, with one word per line."""


def plain_column(*parts: Any, margin: Any = 0, **settings: Any) -> pn.Column:
    """Return a column as wide as its place; the settings are those of `panel.Column`."""
    return pn.Column(*parts, sizing_mode="stretch_width", margin=margin, **settings)


def whole_column(*parts: Any, **settings: Any) -> pn.Column:
    """Return a column as wide as its place and as high as its content; see `WHOLE`."""
    return plain_column(*parts, stylesheets=[WHOLE], **settings)


def plain_row(*parts: Any, margin: Any = 0, **settings: Any) -> pn.Row:
    """Return a row as wide as its place; the settings are those of `panel.Row`."""
    return pn.Row(*parts, sizing_mode="stretch_width", margin=margin, **settings)


def choice_row(choice: Any, words: Any, **settings: Any) -> pn.Row:
    """Return a row of a selection and the text about it; see `WRAP`."""
    return plain_row(choice, words, stylesheets=[WRAP], **settings)


def wide_html(html: str = "", **settings: Any) -> pn.pane.HTML:
    """Return text as wide as its place; the settings are those of `panel.pane.HTML`."""
    return pn.pane.HTML(html, sizing_mode="stretch_width", **settings)


def header_icon(icon: str, description: str) -> pmui.IconButton:
    """Return a button of the header, whose ground is dark in both themes."""
    return pmui.IconButton(
        icon=icon,
        description=description,
        size="small",
        margin=(9, 0),
        stylesheets=[TOOLTIP],
        sx={"color": "#ffffff"},
    )
