"""Scores of learners on a record that is in no folder."""

import pandas as pd

from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.scoring.teacher_forcing import scored_parts


def score_actions(record, experiment, scored, lapse=0.0, *, of=(), draws=None):
    """How likely learners, or one, find each action of the subjects of a record."""
    specs = [scored] if isinstance(scored, LearnerSpec) else scored
    jobs = [(part, spec) for part in recorded_subjects(record, experiment, of) for spec in specs]
    return pd.concat(scored_parts(jobs, lapse, draws, 1, []), ignore_index=True)
