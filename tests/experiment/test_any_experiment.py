"""Any experiment is the same after it was written to a file, or stored, and read again."""

import json
import tempfile
from pathlib import Path

from hypothesis import given, settings

from causal_openlock.experiment.file import read_experiment
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.storage.stored import parse_experiment
from support.any_experiment import experiments


@settings(max_examples=25, deadline=None)
@given(experiments())
def test_an_experiment_is_the_same_from_its_file_and_from_its_folder(drawn):
    with tempfile.TemporaryDirectory() as folder:
        for schema in {one for condition in drawn.conditions for one in condition.schemas}:
            (Path(folder) / f"{schema.name}.yaml").write_text(schema.to_yaml(), encoding="utf-8")
        path = Path(folder) / "drawn.yaml"
        path.write_text(dump_yaml(drawn.as_file(folder)), encoding="utf-8")
        assert read_experiment(path).identity == drawn.identity
    kept = {"identity": drawn.identity, **drawn.as_dict(), "cells": []}
    assert parse_experiment(json.loads(json.dumps(kept))).as_dict() == drawn.as_dict()
