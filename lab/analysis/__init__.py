"""Analysis: the accuracy of a solution, and the consistency of its filter."""
