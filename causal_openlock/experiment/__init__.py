"""Who plays what: protocols, the session that plays them, and the store that keeps the record."""
