"""Files: how files are read within limits and written as a whole, whoever's they are."""
