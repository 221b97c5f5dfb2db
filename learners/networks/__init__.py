"""Networks of many subjects trained side by side, and what they learn from."""
