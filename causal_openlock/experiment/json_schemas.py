"""The JSON Schemas of schema and experiment files: run in a checkout, it writes them anew."""

from __future__ import annotations

import json

from causal_openlock.experiment import declare
from causal_openlock.files.atomic import write_text
from causal_openlock.schemas import schema
from causal_openlock.schemas.finding import bundled

if __name__ == "__main__":
    for kind, module in (("schemas", schema), ("experiments", declare)):
        path = bundled(kind) / "schema.json"
        write_text(path, json.dumps(module.json_schema(), indent=2) + "\n")
        print(path)
