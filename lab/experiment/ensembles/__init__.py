"""Ensembles: many runs, over seeds, values of settings and filters; statistics, and runs eight abreast."""
