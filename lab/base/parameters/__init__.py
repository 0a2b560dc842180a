"""Parameters: settings with unit, bounds and documentation, declared once, and their text and TOML."""
