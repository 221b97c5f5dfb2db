"""Figures, most of them in the form of the paper's: data in, a matplotlib figure out."""
