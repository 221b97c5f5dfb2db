"""Files: written whole or not at all, sealed, checked, and read with the line of every fault."""
