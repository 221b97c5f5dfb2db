"""English: docstrings, messages, templates and pages avoid phrases that readers stumbled on.

The words to write instead are in CONTRIBUTING.md, under "Words".
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.documents import ROOT

PRODUCT = ("causal_openlock", "learners")
KEPT = ("render/words.py",)
"""Files whose texts language models and people are shown: stored replies depend on every word."""

OPENINGS = {
    r"(That|What|Which|Where|Whose|Who|Why)\b": "the name of the thing, or a verb",
    r"(Of|As|In|From|By|With|For|To|So|Among)\b": "the name of the thing, or a verb",
    r"(Its?|Their|Those|These|Both|Some)\b": "the noun",
    r"Whether (it|they|(all|any|some|each|none) of (it|them|these|those))\b": "the noun",
    r"``\[[^]]*\]`` those\b": "the noun",
    r".* of (it|them|these|those)\.?$": "the noun",
}
"""First lines of docstrings, and what they should have instead."""

PHRASES = {
    r"\bso[ -]many\b(?! (\w+ )?that)": "this number of, or the name of the number",
    r"\bis (not )?found of\b": "significant, not significant",
    r"\btold apart\b": "distinguished",
    r"\bof those that (it|they) ha(s|ve)\b": "the noun",
    r"\bnot come so far\b": "did not reach",
    r"(?<!there )\b(is|are|was|were) no (?!longer|more|less|fewer|greater|larger|better)[a-z]": (
        "is not a"
    ),
    r"\b(goes|go|went|going) on\b": "continue",
    r"\bmend(s|ed|ing)?\b": "fix",
    r"\b(come|comes|came|coming) to\b": "amount to, reach, or the verb itself",
    r"(?<![-.])\bbeside\b(?![=(_:])": "next to, compared with",
    r", too\b(?! \w)|\btoo\.": "also",
}
"""Anywhere in a docstring, a message, a template or a page."""

ON_PAGES = PHRASES | {
    r"\btells? [^.]{0,40}\bapart\b": "distinguish",
    r"\b(has|have) not (an?|the)\b": "does not have",
    r"\bone's own\b": "your own",
}
"""Anywhere on a page or in a lesson's prose."""

ANY = re.compile("|".join(PHRASES), re.IGNORECASE)
CODE = re.compile(
    r":\w+:`[^`]*`|``[^`]*``|`[^`]*`|\{[{%#].*?[#%}]\}|^ *>>>.*?(?:\n *\n|\Z)", re.S | re.M
)

NOT_PROSE = re.compile(
    r"<!-- evidence: .*?<!-- end of evidence -->|<!--.*?-->|^ *(```+).*?^ *\1`*$"
    r"|(?<=\n\n)(?: {4,}\S[^\n]*\n)+(?=\n|\Z)|``.*?``|`[^`]*`|\]\([^)]*\)",
    re.S | re.M,
)
"""Generated tables, comments, blocks and spans of code, and where links lead."""


def stumbles(text: str, *, docstring: bool) -> Iterator[tuple[str, str]]:
    """The phrases in a text to be written otherwise, each with what to write instead."""
    first = text.strip().partition("\n")[0]
    if docstring and not first.endswith("?"):
        for opening, better in OPENINGS.items():
            if found := re.match(opening, first):
                yield found.group(), better
    if not ANY.search(" ".join(text.split())):
        return
    prose = " ".join(CODE.sub("``", text).split())
    for phrase, better in PHRASES.items():
        if found := re.search(phrase, prose, re.IGNORECASE):
            yield found.group(), better


def texts(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Docstrings, and messages of at least three words, each with its line."""
    if path.suffix == ".j2":
        yield 1, path.read_text("utf-8"), False
        return
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):  # a body before what is in it
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            docstring = id(node) in docstrings
            if docstring or len(node.value.split()) > 2:
                yield node.lineno, node.value, docstring
        elif isinstance(body := getattr(node, "body", None), list):
            docstrings |= {id(one.value) for one in body if isinstance(one, ast.Expr)}


def stumbles_on_page(text: str) -> Iterator[tuple[int, str, str]]:
    """The phrases of a page in Markdown to be written otherwise, each with its line."""
    prose = NOT_PROSE.sub(lambda code: "``" + "\n" * code.group().count("\n"), text)
    for phrase, better in ON_PAGES.items():
        for found in re.finditer(phrase.replace(" ", r"\s"), prose, re.IGNORECASE):
            yield prose.count("\n", 0, found.start()) + 1, " ".join(found.group().split()), better


def pages() -> Iterator[tuple[str, str]]:
    """The pages that people have written, and the prose of lessons, each with its name."""
    written = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"]
    written += [ROOT / "evidence" / "README.md"]
    for path in sorted((ROOT / "docs").rglob("*.md")):
        if path.relative_to(ROOT / "docs").parts[0] not in ("_build", "api", "evidence", "lessons"):
            written.append(path)
    for path in written:
        yield path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        for number, cell in enumerate(json.loads(path.read_text("utf-8"))["cells"]):
            if cell["cell_type"] == "markdown":
                yield f"notebooks/{path.name}, cell {number}", "".join(cell["source"])


def test_nobody_stumbles_over_pages_and_lessons() -> None:
    texts = [*pages()]
    assert len(texts) > 100
    found = [
        f"{name}:{line}: {phrase!r}; write {better}"
        for name, text in texts
        for line, phrase, better in stumbles_on_page(text)
    ]
    assert not found, "\n".join(found)


def test_nobody_stumbles_over_docstrings_messages_and_templates() -> None:
    paths = sorted(
        path
        for folder in PRODUCT
        for ending in ("py", "j2")
        for path in (ROOT / folder).rglob(f"*.{ending}")
    )
    assert len(paths) > 300
    found = [
        f"{name}:{line}: {phrase!r}; write {better}"
        for path in paths
        for name in [path.relative_to(ROOT).as_posix()]
        for line, text, docstring in texts(path)
        if docstring or not name.endswith(KEPT)
        for phrase, better in stumbles(text, docstring=docstring)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "What a subject believes.",
        "Of each of them.",
        "Whether all of them were.",
        "``[B, A]`` those of the policy.",
        "Copies of a subject, and the draws of them.",
        "Play so many copies.",
        "The name is no action.",
        "Raised if a file\nis no schema.",
        "A fit, which goes on later.",
        "Errors that users can mend.",
        "The sum comes to 1.",
        "A console beside the room.",
        "A learner that reads files, too.",
        "Theories that cannot be told apart.",
    ],
)
def test_a_phrase_to_avoid_is_found(text: str) -> None:
    assert [*stumbles(text, docstring=True)]


@pytest.mark.parametrize(
    "text",
    [
        "Return the belief of a subject.",
        "Which learners discover a schema?",
        "Whether every solution was found.",
        "Number of copies; there is no limit.",
        "A learner that is no longer supported.",
        "Search ``beside``, then `--beside`; too many are refused.",
        "Say it.\n\n>>> print('this is no action')\nthis is no action\n",
        "Refuse numbers with so many digits that reading takes long.",
    ],
)
def test_plain_english_passes(text: str) -> None:
    assert not [*stumbles(text, docstring=True)]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("# Films\n\nIt needs Pillow, which is\nno requirement.", 3),
        ("A run\ncontinues, inside a cell too.", 2),
        ("![Play beside learners](play.png)", 1),
        ("- `rl2` tells two kinds apart.", 1),
        ("    indented, of a list; it\n    goes on.\nAnd on.", 2),
        ("```\ngoes on\n```\nand goes on", 4),
        ("Learn with a memory of one's own.", 1),
    ],
)
def test_a_phrase_on_a_page_is_found_with_its_line(text: str, line: int) -> None:
    assert [number for number, *_ in stumbles_on_page(text)] == [line]


@pytest.mark.parametrize(
    "text",
    [
        "```console\n$ causal-openlock compare\nit goes on\n```\n",
        "1. A list\n\n   ```\n   is no action\n   ```\n",
        "As follows\n\n    make it  # and it goes on\n\nThen",
        "<!-- evidence: a b -->\n| they cannot be told apart |\n<!-- end of evidence -->\n",
        "Use `--beside`, [the folder](told_apart_beside.md).",
    ],
)
def test_code_and_generated_tables_of_a_page_pass(text: str) -> None:
    assert not [*stumbles_on_page(text)]
