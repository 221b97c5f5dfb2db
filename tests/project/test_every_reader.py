"""Every place that reads a file is known: spoiled files reach it, or a reason says why not."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.places import ROOT

with pytest.MonkeyPatch.context() as _patch:
    _patch.syspath_prepend(ROOT / "benchmarks")
    import fuzz_readers

READS = {"read_text", "read_bytes", "ParquetFile", "ZipFile", "cat_file", "read_csv"}
READS |= {"read_parquet", "read_table", "open", "load"}

FUZZED = {
    "causal_openlock/analysis/topics/language_models.py": "transcripts",
    "causal_openlock/evidence/study_files.py": "run.json",
    "causal_openlock/experiment/answers.py": "people's answers",
    "causal_openlock/storage/cell_file.py": "cells",
    "causal_openlock/running/checkpoint.py": "checkpoints",
    "causal_openlock/storage/running_files.py": "progress",
    "causal_openlock/storage/store.py": "experiment.json",
    "causal_openlock/files/checksums.py": "cells",
    "causal_openlock/files/seal.py": "checkpoints",
    "causal_openlock/files/state.py": "networks",
    "causal_openlock/files/yaml_file.py": "schema files",
    "causal_openlock/fitting/kept.py": "fits",
    "causal_openlock/schemas/graphs.py": "dot",
    "causal_openlock/importing/jspsych.py": "imported jsPsych",
    "causal_openlock/importing/csv_tables.py": "imported CSV",
    "causal_openlock/importing/text.py": "imported CSV",
    "causal_openlock/play/log.py": "logs of people",
    "causal_openlock/experiment/reactions.py": "reaction times",
    "causal_openlock/scoring/score_table.py": "scores",
    "learners/openlock_learners/language/kept_replies.py": "replies of models",
}
"""The line of ``benchmarks/fuzz_readers.py`` that reaches a module's readers."""

NOT = {
    "causal_openlock/analysis/prose.py": "templates of installed packages",
    "causal_openlock/analysis/report/methods.py": "a file of the package",
    "causal_openlock/comparison/checking.py": "a file of the package",
    "causal_openlock/analysis/report/page.py": "the names of files in a page, by their form",
    "causal_openlock/analysis/report/writing.py": "opens the page that was just written",
    "causal_openlock/cli/notebook.py": "a file of the package",
    "causal_openlock/play/command.py": "the text of a consent, of any content",
    "causal_openlock/comparison/comparing.py": "copies cells whole",
    "causal_openlock/contract/registry.py": "the metadata of an installed package",
    "causal_openlock/fitting/design.py": "what is not whole is made again",
    "causal_openlock/evidence/checking.py": "pages of the project, of any content",
    "causal_openlock/evidence/figures.py": "a figure of the project, of any content",
    "causal_openlock/evidence/keeping.py": "the processor's name",
    "causal_openlock/evidence/recovery_runs.py": "seconds that the same command has kept",
    "causal_openlock/evidence/running.py": "the log and the cells of the same command",
    "causal_openlock/cli/__init__.py": "what packages register, which is run",
    "causal_openlock/files/plugins.py": "what packages register, which is run",
    "causal_openlock/running/carried_code.py": "modules of the user, which are run",
    "causal_openlock/storage/failures.py": "a sentence, of any content",
    "causal_openlock/storage/folder_lock.py": "an empty file",
    "causal_openlock/storage/remote.py": "copies files whole",
    "causal_openlock/running/runner.py": "opens a store",
    "causal_openlock/export/bundle.py": "copies files whole",
    "causal_openlock/export/croissant.py": "files of the package",
    "causal_openlock/usercode/code_digest.py": "modules of the user, which are run",
    "causal_openlock/usercode/local_modules.py": "modules of the user, which are run",
    "causal_openlock/importing/folder.py": "opens a store",
    "causal_openlock/notebook.py": "the page that was just written",
    "causal_openlock/play/background.py": "opens a browser",
    "causal_openlock/play/forgetting.py": "opens a store",
    "causal_openlock/play/pages.py": "files of the package",
    "causal_openlock/play/people.py": "opens a store",
    "causal_openlock/render/video.py": "the film that was just made",
    "causal_openlock/world/facts/__init__.py": "files of the package",
    "causal_openlock/world/reward_code.py": "a module of the user, which is run",
    "learners/openlock_learners/rl2.py": "a digest of any content",
}
"""Why spoiled files are not given to other modules that read."""


def _modules() -> Iterator[tuple[str, Path]]:
    for folder in ("causal_openlock", "learners"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path


def _reads(text: str) -> bool:
    calls = [one.func for one in ast.walk(ast.parse(text)) if isinstance(one, ast.Call)]
    names = {one.attr for one in calls if isinstance(one, ast.Attribute)}
    return bool(READS & (names | {one.id for one in calls if isinstance(one, ast.Name)}))


def test_every_module_that_reads_files_is_fuzzed_or_says_why_not() -> None:
    reading = {name for name, path in _modules() if _reads(path.read_text(encoding="utf-8"))}
    unknown = sorted(reading - {*FUZZED, *NOT})
    assert not unknown, f"give {unknown} a line in benchmarks/fuzz_readers.py, and name it here"
    assert not sorted({*FUZZED, *NOT} - reading), "these read nothing any more"
    assert not {*FUZZED} & {*NOT}


def test_the_lines_that_are_named_are_there(tmp_path: Path) -> None:
    lines = {one.name for one in fuzz_readers.readers(tmp_path)}
    assert {*FUZZED.values()} <= lines


def test_a_module_that_reads_is_found() -> None:
    assert _reads("from pathlib import Path\ndef f(p):\n    return Path(p).read_text()")
    assert _reads("with open('x') as file:\n    pass")
    assert not _reads("def f(p):\n    return str(p)")
