"""Files: one module for each format of flight recordings and sensor logs; `lab.data.formats` chooses."""
