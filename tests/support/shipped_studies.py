"""The studies of the folder ``evidence``, each read once for all tests of a process."""

from evidence.study import read_studies
from support.places import ROOT

EVIDENCE = ROOT / "evidence"
STUDIES = {study.name: study for study in read_studies(EVIDENCE)}
"""By name; an experiment is read when it is asked for."""
DECLARED = [name for name, study in STUDIES.items() if not study.file.published]
"""Studies whose experiments can be read; of others only results are stored."""
