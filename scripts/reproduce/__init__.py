"""The figures and tables of the papers made anew: one module per paper, and what they share."""
