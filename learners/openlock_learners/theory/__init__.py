"""The spaces that the theory-based model reasons over: chains and schemas."""
