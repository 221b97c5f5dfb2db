"""Whether the parameters of a learner can be found again in what it did.

Subjects are simulated with parameters drawn from the ranges in which they are searched. What is
fitted to their actions is compared with what made them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.contract.registry import changed_parameters
from causal_openlock.design.apart import simulated
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import Experiment, LearnerSpec
from causal_openlock.experiment.making import learner, make_experiment
from causal_openlock.fitting.plan import FitSettings, Plan, bundled_plan
from causal_openlock.fitting.search import at_bound
from causal_openlock.fitting.to_actions import fit_all
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.recorded import Recorded
from causal_openlock.world.randomness import generators


def searched(spec: LearnerSpec, ranges: Sequence[str] = ()) -> Plan:
    """Search space of a learner as it is set; ``ranges``, such as ``name=low:high``, replace it.

    Raises:
        OpenLockError: If there are none, or they do not fit the learner.
    """
    if ranges:
        fixed = changed_parameters(spec.learner, spec.parameters)
        return Plan(spec.learner, fixed, {}).changed(ranges, (), ())
    space = bundled_plan(spec.learner)
    if space is None or any(spec.parameters[name] != value for name, value in space.fixed.items()):
        raise LearnerError(
            f"{spec.name} has no search space of its own as it is set, so its parameters cannot "
            "be recovered; give ranges, such as --search name=low:high, or take bayes with the "
            "policy thompson, or theory_based"
        )
    return space


def parameters_recovered(
    spec: LearnerSpec,
    space: Plan,
    experiment: Experiment,
    folder: Path,
    *,
    sets: int = 20,
    candidates: int = 160,
    lapse: float = LAPSE,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> pd.DataFrame:
    """Simulate subjects with drawn parameters of a learner, and fit its parameters to them.

    As many ``sets`` of parameters are drawn from the ``space`` of :func:`searched`; for each,
    subjects are simulated, and as many ``candidates`` are tried to fit them, with a share ``lapse``
    of actions taken to be random. Fits are stored in the folder, where the work continues after an
    interruption; ``report`` is called with how many sets are fitted, of how many.

    Returns:
        A row for each ``set`` and ``parameter``: the ``true`` value, the ``fitted`` one, and
        whether that is ``at_bound``.

    Raises:
        LearnerError: If the learner cannot be put in another's place.
    """
    truth = [
        {name: bounds.at(generator.random()) for name, bounds in space.ranges.items()}
        for generator in generators(experiment.seed, f"parameters/{space.learner}", range(sets))
    ]
    makers = [
        learner(space.learner, label=f"set_{number:03}", subjects=1, **space.parameters(chosen))
        for number, chosen in enumerate(truth)
    ]
    conditions, seed = list(experiment.conditions), experiment.seed
    drawn = make_experiment(conditions, makers, protocol=spec.protocol, seed=seed)
    parts: dict[str, list[Recorded]] = defaultdict(list)
    for cell in drawn.cells():
        parts[cell.spec.name].append(simulated(cell, drawn))
    how = FitSettings(lapse=lapse, hold_out="none", candidates=candidates, seed=seed)
    fits = fit_all(parts, replace(space, fit=how), folder, workers=workers, report=report)
    return pd.DataFrame(
        {"set": number, "parameter": name, "true": true[name], "fitted": fit.chosen[name],
         "at_bound": name in at_bound(space.ranges, fit.chosen)}
        for number, (true, fit) in enumerate(zip(truth, fits, strict=True))
        for name in space.ranges
    )  # fmt: skip


def on_search_scale(pairs: pd.DataFrame, space: Plan) -> pd.DataFrame:
    """The pairs of :func:`parameters_recovered`, logarithms where these are searched."""
    logs = pairs["parameter"].map({name: bounds.log for name, bounds in space.ranges.items()})
    scaled = {name: pairs[name].where(~logs, np.log(pairs[name].where(logs, 1.0)))
              for name in ("true", "fitted")}  # fmt: skip
    return pairs.assign(**scaled)


def correlations(pairs: pd.DataFrame, space: Plan) -> pd.DataFrame:
    """Whether each parameter is recovered: a row for each, by its name.

    Returns:
        ``r``, the correlation of true and fitted values on the scale that is searched (NaN where
        one of the two does not vary); the number of ``sets``; and how many are ``at_bound``.
    """
    by_name = on_search_scale(pairs, space).groupby("parameter", sort=False)
    with np.errstate(invalid="ignore", divide="ignore"):
        r = by_name[["true", "fitted"]].apply(lambda own: own["true"].corr(own["fitted"]))
    return pd.DataFrame({"r": r, "sets": by_name.size(), "at_bound": by_name["at_bound"].sum()})
