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
MOST_PLOTS = 4
"""Maximum number of learners that get a figure; tables list all."""
MOST_SUBJECTS = 200
"""Maximum number of subjects that get a row; ``followed.csv`` lists all."""
SURE = 0.9
"""Probability from which a subject is said to follow a learner."""
_NAMES = {
    **{"scored": "predicted by", "worse": "more than best", "worse_low": "low"},
    **{"worse_high": "high", "p_corrected": "p corrected", "best_of": "best of"},
    **{"frequency": "followed"},
}
_FORMATS = {
    **dict.fromkeys(("bits", "probability"), ".2f"),
    **dict.fromkeys(("more than best", "low", "high"), "+.2f"),
    **{"p corrected": "s", "followed": ".0%", "subjects": ",", "ahead": ",.1f"},
}


def section(material: Material) -> Section | None:
    """Section: the best predictor, and the learners that subjects follow; or None."""
    by_learner, notes = stored_scores(material)
    if not by_learner:
        return Section("scores", TITLE, tuple(notes)) if notes else None
    ranked = {of: _ranked(scores) for of, scores in by_learner.items()}
    text = [_about(material, by_learner), *notes]
    text += [_predicted(of, scores, ranked[of]) for of, scores in [*by_learner.items()][:8]]
    caption = (
        "Bits: mean of subjects. More than best: on the same subjects, with its 95% interval over "
        "subjects (none where a subject did what the learner takes for impossible); p: paired, "
        "corrected for the learners that are compared; best of: subjects that no learner predicts "
        "better. The best was chosen by the same subjects, which favours it. Followed: the share "
        "of subjects that follow a learner if each follows one of these (random-effects model "
        "selection with −BIC/2 for the log evidence)."
    )
    columns = ["of", "scored", "subjects", "bits", *[*_NAMES][1:]]
    table = _of_each(ranked)[columns]
    frame = table.assign(p_corrected=table["p_corrected"].map(p_value)).rename(columns=_NAMES)
    tables = [Table("scores", "Bits per action, and who follows whom", frame, _FORMATS, caption)]
    followed = _of_each({of: by_learner[of].attributed for of in ranked if len(ranked[of]) > 1})
    if 0 < len(followed) <= MOST_SUBJECTS:
        caption = (
            "If each subject follows one of these: the learner that it most probably follows, with "
            "what probability, and by how many nats its evidence (−BIC/2) is ahead of the best of "
            "the others. The probability takes into account how many others follow each learner."
        )
        frame = followed[["of", "condition", "subject", "follows", "probability", "ahead"]]
        title = "Which learner each subject follows"
        tables.append(Table("attributed", title, frame, _FORMATS, caption))
    plots = [
        drawn(
            f"scores_{part}",
            Scores.plot,
            by_learner[of],
            f"Bits per action over trials: what {of} did",
            "How many bits per action each learner needs in each trial, the fewer the better: mean "
            f"of subjects{', with 95% intervals over subjects' if len(ranked[of]) <= 4 else ''}. "
            "Thin lines are single subjects; dotted: what a learner that knows nothing needs. A "
            "trial without a point has an action that the learner takes for impossible.",
            f"results.scores.plot(of={of!r})",
            of=of,
        )
        for of, part in [*file_names(by_learner).items()][:MOST_PLOTS]
    ]
    return Section("scores", TITLE, tuple(text), tuple(tables), tuple(plots))


def _ranked(scores: Scores) -> pd.DataFrame:
    """The learners, the best predictor first, and how many subjects follow each."""
    ranked = scores.ranking.merge(scores.followed.drop(columns="exceedance"), on="scored")
    return ranked.assign(
        p_corrected=holm(ranked["p"].where(ranked["worse"].notna()).to_numpy(float))
    )


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
    """The best predictor of one learner's subjects, and the learners that they follow."""
    best, others = ranked.iloc[0], ranked.iloc[1:]
    own = scores.actions[scores.actions["scored"] == best["scored"]]
    size = {name: np.log2(count) for name, count in scores.choices.items()}
    uniform = own["condition"].astype(str).map(size).mean()
    beaten = others["p_corrected"] < ALPHA
    most = ranked.loc[ranked["frequency"].idxmax()]
    sure = scores.attributed.query("probability >= @SURE")["follows"].value_counts()
    interval = f" ({best['low']:.2f} to {best['high']:.2f})" if np.isfinite(best["low"]) else ""
    said = [
        f"Of {of}, {counted(best['subjects'], 'subject')} with {counted(len(own), 'action')}: "
        f"{best['scored']} predicts best, with {best['bits']:.2f} bits per action{interval}; a "
        f"learner that knows nothing needs {uniform:.2f}."
    ]
    if beaten.any():
        said.append(
            f"It predicts better than {joined([*others['scored'][beaten]])}, significantly after "
            "correction for all learners that are compared."
        )
    if not beaten.all():
        names = joined([*others["scored"][~beaten]])
        said.append(f"From {names} it does not differ significantly.")
    said.append(
        f"If each subject follows one of these, {most['frequency']:.0%} follow {most['scored']}, "
        f"which is the most frequent with probability {most['protected']:.2f}."
    )
    if len(sure) > 1:
        groups = joined([f"{name} ({many})" for name, many in sure.items()])
        said.append(
            f"They do not all follow the same one (with a probability of at least {SURE}: "
            f"{groups}), and means over all of them describe none of these groups."
        )
    return " ".join(said)


TOPIC = Topic("scores", 25, section)
