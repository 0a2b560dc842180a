"""Analysis: how good a solution is, and whether its filter knows."""
