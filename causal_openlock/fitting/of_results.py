"""``results.score``: let learners predict the actions of the subjects of a results folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from causal_openlock.comparison.results import Results
from causal_openlock.errors import StoreError
from causal_openlock.experiment.making import LearnerForm, listed, make_experiment
from causal_openlock.fitting.predicting import read_fit, score_fits
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.scores import Scores
from causal_openlock.scoring.teacher_forcing import known_learners
from causal_openlock.storage.store import Store


def score(
    results: Results,
    /,
    learners: LearnerForm | Sequence[LearnerForm] = (),
    *,
    fits: Sequence[Path | str] = (),
    of: Sequence[str] | str = (),
    lapse: float = LAPSE,
    workers: int = 1,
) -> Scores:
    """Let learners predict every action of these subjects: who predicts best?

    Args:
        results: The results of one folder; in ``results.score(...)`` it is given.
        learners: As in :func:`~causal_openlock.compare`.
        fits: Folders of fits to actions; each predicts by its folder's name.
        of: Labels of the learners whose subjects are predicted; by default all.
        lapse: The share of actions that are taken to be random.
        workers: How many processes work; with one it is this process.

    Raises:
        LearnerError: If a learner cannot be put in another's place.
        StoreError: If the results are from several folders, or cannot be played again.

    Example:
        >>> from causal_openlock import compare
        >>> results = compare("CC3", ["oracle"], subjects=2, workers=1)
        >>> results.score(["random", "oracle"]).ranking["scored"].tolist()
        ['oracle', 'random']
    """
    if len(results.folders) != 1:
        raise StoreError("score the results of one folder at a time")
    asked = listed(learners)
    predicting = make_experiment(["CC4"], asked).learners if asked else ()
    fitted = [read_fit(Path(one), [spec.learner for spec in predicting]) for one in fits]
    of = [one.name for one in known_learners(of, results.experiment.learners)]
    record, experiment = Store(results.folders[0]).record()
    return score_fits(record, experiment, fitted, predicting, of=of, lapse=lapse, workers=workers)
