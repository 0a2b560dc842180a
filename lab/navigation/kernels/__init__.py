"""Kernels: code that is generated for one filter and compiled, for one run or for eight abreast.

In: the pattern of an error model and the options of a filter. Out: one compiled function that navigates a
flight. Read `generation` (how the text of a kernel is written), `driver` (the loop over samples and fixes)
and `lanes` (eight runs abreast). `docs/compiling.md` says what a new release of Numba may break.
"""
