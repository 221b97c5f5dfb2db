"""The JSON Schemas by which editors check and complete schema and experiment files.

In a checkout, ``python -m causal_openlock.experiment.json_schemas`` writes them beside the files
that they describe.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from causal_openlock.experiment import file as experiment_file
from causal_openlock.files.atomic import write_text
from causal_openlock.formats import schema_file
from causal_openlock.formats.schema_file import bundled


def json_schema_files() -> dict[Path, dict[str, Any]]:
    """The files and what belongs into them."""
    return {
        bundled("schemas") / "schema.json": schema_file.json_schema(),
        bundled("experiments") / "schema.json": experiment_file.json_schema(),
    }


if __name__ == "__main__":
    for path, content in json_schema_files().items():
        write_text(path, json.dumps(content, indent=2) + "\n")
        print(path)
