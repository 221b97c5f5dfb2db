"""A section of the report: which learner predicts what subjects did, if they were scored.

It is made of what ``causal-openlock score`` left in a results folder. Statistics are those of
:mod:`~causal_openlock.scoring.scores`, for the subjects of each learner by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, holm
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table, p_value
from causal_openlock.analysis.topic import Section, Topic, drawn, sentences
from causal_openlock.scoring.scores import SUBJECT, Scores, stored_scores
from causal_openlock.wording import counted, file_names, joined

TITLE = "Who predicts what was done"
MOST_PLOTS = 4  #: maximum number of learners that get a figure; tables list all
MOST_SUBJECTS = 200  #: maximum number of subjects that get a row; ``followed.csv`` lists all
HEADS = {
    **{"scored": "predicted by", "bits": "bits/action", "worse": "more than the best"},
    **{"worse_low": "low", "worse_high": "high", "p": "p", "best_of": "best of"},
    **{"frequency": "followed by", "protected": "most frequent"},
}
"""Heads of the columns of a ranking, in the report and on the terminal."""
FORMATS = {
    **dict.fromkeys(("bits/action", "most frequent", "probability"), ".2f"),
    **dict.fromkeys(("more than the best", "low", "high"), "+.2f"),
    **{"p": "s", "followed by": ".0%", "subjects": ",", "ahead": ",.1f"},
}


def ranked(scores: Scores) -> pd.DataFrame:
    """The best predictor first, and how many subjects follow each, with corrected ``p``."""
    table = scores.ranking.merge(scores.followed, on="scored")
    return table.assign(p=holm(table["p"].where(table["worse"].notna()).to_numpy(float)))


def section(material: Material) -> Section | None:
    """Section: the best predictor, and the learners that subjects follow; or None."""
    scores, notes = stored_scores(material)
    if scores is None:
        return Section("scores", TITLE, tuple(notes)) if notes else None
    by_learner = {name: scores.of(name) for name in scores.actions["learner"].unique()}
    rankings = {of: ranked(scores) for of, scores in by_learner.items()}
    text = [_about(material, by_learner), *notes]
    text += [_predicted(of, scores, rankings[of]) for of, scores in [*by_learner.items()][:8]]
    caption = (
        "Bits per action: mean of subjects. More than the best: on the same subjects, with its 95% "
        "interval over subjects (none where a subject did what the learner takes for impossible); "
        "p: paired, corrected for the learners that are compared; best of: subjects that no "
        "learner predicts better. The best was chosen by the same subjects, which favours it. "
        "Followed by: the share of subjects that follow a learner if each follows one of these "
        "(random-effects model selection with −BIC/2 for the log evidence); most frequent: the "
        "protected probability that more follow it than any other."
    )
    table = _of_each(rankings)[["of", "subjects", *HEADS]]
    frame = table.assign(p=table["p"].map(p_value)).rename(columns=HEADS)
    tables = [Table("scores", "Bits per action, and who follows whom", frame, FORMATS, caption)]
    followed = _of_each({of: by_learner[of].attributed for of in rankings if len(rankings[of]) > 1})
    if 0 < len(followed) <= MOST_SUBJECTS:
        caption = (
            "If each subject follows one of these: the learner that it most probably follows, with "
            "what probability, and by how many nats its evidence (−BIC/2) is ahead of the best of "
            "the others. The probability takes into account how many others follow each learner."
        )
        frame = followed[["of", "condition", "subject", "follows", "probability", "ahead"]]
        title = "Which learner each subject follows"
        tables.append(Table("attributed", title, frame, FORMATS, caption))
    plots = [
        drawn(
            f"scores_{part}",
            Scores.plot,
            by_learner[of],
            f"Bits per action over trials: what {of} did",
            "How many bits per action each learner needs in each trial, the fewer the better: mean "
            f"of subjects{', with 95% intervals over subjects' if len(rankings[of]) <= 4 else ''}. "
            "Thin lines are single subjects; dotted: what a learner that knows nothing needs. A "
            "trial without a point has an action that the learner takes for impossible.",
            f"results.scores.plot(of={of!r})",
            of=of,
        )
        for of, part in [*file_names(by_learner).items()][:MOST_PLOTS]
    ]
    return Section("scores", TITLE, tuple(text), tuple(tables), tuple(plots))


def _of_each(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Join tables about the subjects of several learners, who are in the column ``of``."""
    return pd.concat([table.assign(of=of) for of, table in tables.items()] or [pd.DataFrame()])


def _about(material: Material, each: Mapping[str, Scores]) -> str:
    """What was done, and how many subjects of the same learners are not scored."""
    scored = sum(len(one.subjects[SUBJECT].drop_duplicates()) for one in each.values())
    known = material.trials[material.trials["learner"].isin([*each])]
    more = len(known[SUBJECT].drop_duplicates()) - scored
    return sentences(
        f"Learners were put in the place of {counted(scored, 'subject')}: each saw what the "
        "subject saw, said how likely each action was, and was then shown what the subject did. "
        "Bits per action are what it needed to say what was done, the fewer the better.",
        f"{more} more of the same learners are on record, and not scored." if more else "",
    )


def _predicted(of: str, scores: Scores, ranked: pd.DataFrame) -> str:
    """The best predictor of one learner's subjects, and those that are not significantly worse."""
    best, others = ranked.iloc[0], ranked.iloc[1:]
    own = scores.actions[scores.actions["scored"] == best["scored"]]
    size = {name: np.log2(count) for name, count in scores.choices.items()}
    uniform = own["condition"].astype(str).map(size).mean()
    beaten = others["p"] < ALPHA
    interval = f" ({best['low']:.2f} to {best['high']:.2f})" if np.isfinite(best["low"]) else ""
    return sentences(
        f"Of {of}, {counted(best['subjects'], 'subject')} with {counted(len(own), 'action')}: "
        f"{best['scored']} predicts best, with {best['bits']:.2f} bits per action{interval}; a "
        f"learner that knows nothing needs {uniform:.2f}.",
        f"It predicts better than {joined([*others['scored'][beaten]])}, significantly after "
        "correction for all learners that are compared."
        if beaten.any()
        else "",
        f"From {joined([*others['scored'][~beaten]])} it does not differ significantly."
        if not beaten.all()
        else "",
    )


TOPIC = Topic("scores", 25, section)
