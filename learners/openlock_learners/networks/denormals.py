"""Denormal numbers, flushed to zero while networks are trained and at no other time.

Sparse rewards let the moments of Adam decay into denormal numbers, with which arithmetic is several
times slower. The setting is the whole process's and changes what other code computes, so that it is
put back after every update.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def denormals_flushed() -> Iterator[None]:
    """Treat denormal numbers as zero within the block."""
    import torch

    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
