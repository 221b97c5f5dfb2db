"""The JSON Schemas with which editors check and complete schema and experiment files.

In a checkout, ``python -m causal_openlock.experiment.json_schemas`` writes them next to the files
that they describe.
"""

from __future__ import annotations

import json

from causal_openlock.experiment import declare
from causal_openlock.files.atomic import write_text
from causal_openlock.schemas import schema
from causal_openlock.schemas.finding import bundled

if __name__ == "__main__":
    schemas, experiments = schema.json_schema(), declare.json_schema()
    for kind, made in (("schemas", schemas), ("experiments", experiments)):
        path = bundled(kind) / "schema.json"
        write_text(path, json.dumps(made, indent=2) + "\n")
        print(path)
