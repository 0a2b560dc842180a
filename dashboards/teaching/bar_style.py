"""Bar style: the line of a class above all tabs, for students and teachers."""

from __future__ import annotations

from typing import Any

BAR = """
:host { align-items: center; border-bottom: 1px solid rgba(128,128,128,.25);
        background: rgba(27,98,185,.09); flex: 0 0 auto !important; max-height: none !important; }
"""
WORDS = "div { font: 14px/1.4 Roboto, sans-serif; } b { font-weight: 600; }"
BUTTON: dict[str, Any] = {"variant": "outlined", "size": "small", "margin": (6, 4), "align": "center"}
"""Options of all buttons in the line."""
TOGGLE: dict[str, Any] = {
    "& .MuiToggleButton-root, &.MuiToggleButton-root": {
        "textTransform": "none",
        "fontSize": "0.8125rem",
        "padding": "3px 9px",
        "gap": "6px",
    }
}
"""Style of a button that stays pressed: as high as the others."""
