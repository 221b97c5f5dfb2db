"""Numbers and names in sentences: one attempt, two attempts."""

import pytest

from causal_openlock.wording import counted, first_line, nearest


@pytest.mark.parametrize(
    ("docstring", "line"),
    [
        ("A learner (extra ``llm``).\n\nMore.", "A learner (extra llm)."),
        ("Draws as :class:`~openlock_learners.random.RandomLearner`.", "Draws as RandomLearner."),
        ("See :py:func:`a.b` and `the paper <https://x.org>`_.", "See a.b and the paper."),
        ("\n   Plays\t``a < b``, \x1b[1mbold\u202e. \n", "Plays a < b, [1mbold."),
        (None, ""),
    ],
)
def test_first_line_of_a_docstring_is_plain_text(docstring, line):
    assert first_line(docstring) == line


def test_counted_nouns_and_nearest_names():
    numbers = [counted(number, "attempt") for number in (0, 1, 2000)]
    assert numbers == ["0 attempts", "1 attempt", "2,000 attempts"]
    assert counted(1, "person", "people") == "1 person"
    assert counted(3, "person", "people") == "3 people"
    # Digits that are no numbers are letters, and numbers are ordered as numbers.
    assert nearest("₁", ["₂", "x²", "x10", "x2"]).endswith("known: x2, x10, x², ₂")
