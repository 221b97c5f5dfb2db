"""Files of trained models, which a learner is given by path and which may be anybody's."""

from __future__ import annotations

from pathlib import Path

from causal_openlock.errors import LearnerError, in_short

MOST_BYTES = 1 << 27
"""Most bytes that a file may have."""
BUNDLED = Path(__file__).parent / "checkpoints" / "rl2.npz"
"""The network of ``rl2`` that comes with the package."""


def content_of(path: Path | str) -> bytes:
    """Return the bytes of a trained model's file.

    Raises:
        LearnerError: If it cannot be read, or is larger than :data:`MOST_BYTES`.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MOST_BYTES or not path.is_file():
            raise ValueError("it is not a file of at most 128 MiB")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise LearnerError(
            f"{path} cannot be read ({in_short(error)}); name the file of a trained model"
        ) from None
