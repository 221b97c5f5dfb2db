"""Figures in the paper's form, and what all figures share: results in, matplotlib axes out."""
