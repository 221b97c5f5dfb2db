"""Progress of a hierarchical fit, which continues where it stopped.

A fit takes the same steps in the same order each time. The result of each is stored as soon as it
is known, and a resumed fit asks for all results again: those that are known are not repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from causal_openlock.errors import StoreError
from causal_openlock.fitting.actions import (
    DIFFERING,
    FILE,
    ActionPlan,
    Fitted,
    fits_of,
    subjects_of,
)
from causal_openlock.fitting.group import Peak
from causal_openlock.fitting.kept import fit_of, keep_fit
from causal_openlock.fitting.subject_peak import PeakJob, StartJob, Starts, peak_job, start_job
from causal_openlock.scoring.teacher_forcing import Recorded

PROGRESS = "hierarchical.json"
"""File of the finished steps of a fit."""

Do = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""Function that carries out another one on several jobs, in their order."""


class Progress:
    """The steps of a hierarchical fit in a folder: those that are known, and then the others.

    Args:
        parts: The subjects.
        plan: The settings of the fit.
        folder: Where it is kept.
        do: What carries out the steps that are not known.

    Raises:
        StoreError: If the folder holds another fit, or no fit.
    """

    def __init__(self, parts: Sequence[Recorded], plan: ActionPlan, folder: Path, do: Do) -> None:
        self._parts, self._plan, self._folder, self._do = parts, plan, folder, do
        self._about = {**plan.as_dict(), "hierarchical": True, "subjects": subjects_of(parts)}
        fit_of(folder / FILE, self._about, self._fits, "fit to actions", DIFFERING)
        kept = fit_of(folder / PROGRESS, self._about, self._steps, "fit to actions", DIFFERING)
        self._starts, self._peaks = kept or ([], [])
        self._known = iter(list(self._peaks))

    def starts(self) -> Starts:
        """Start of the search for the peak of each subject."""
        jobs = [StartJob(part, self._plan) for part in self._parts]
        for found in self._do(start_job, jobs[len(self._starts) :]):
            self._starts.append(found)
            self._keep()
        return {who: at for part in self._starts for who, at in part.items()}

    def peaks(self, jobs: Sequence[PeakJob]) -> list[Peak]:
        """Peaks that some jobs find."""
        peaks = list(islice(self._known, len(jobs)))
        for found in self._do(peak_job, jobs[len(peaks) :]):
            peaks.append(found)
            self._peaks.append(found)
            self._keep()
        return peaks

    def finish(self, fits: Sequence[Fitted]) -> None:
        """Store the result of the fit.

        Raises:
            StoreError: If more is kept than was asked for.
        """
        if next(self._known, None):
            raise StoreError(
                f"{self._folder / PROGRESS}: this is not a fit; choose another folder with --out"
            )
        keep_fit(self._folder / FILE, self._about, done=[asdict(one) for one in fits])

    def _keep(self) -> None:
        peaks = [asdict(one) for one in self._peaks]
        keep_fit(self._folder / PROGRESS, self._about, starts=self._starts, peaks=peaks)

    def _fits(self, kept: Mapping[str, Any]) -> list[Fitted]:
        return fits_of(kept, self._plan.space.ranges)

    def _steps(self, kept: Mapping[str, Any]) -> tuple[list[Starts], list[Peak]]:
        """Content of a file; raises ValueError if it is not of this learner and these subjects."""
        starts = TypeAdapter(list[Starts]).validate_python(kept["starts"])
        peaks = TypeAdapter(list[Peak]).validate_python(kept["peaks"])
        alone = [part.alone() for part in self._parts]
        if [[*one] for one in starts] != [[*own] for own in alone][: len(starts)]:
            raise ValueError("the subjects are in another order")
        actions = [len(one.done()[0]) for own in alone for one in own.values()]
        for number, one in enumerate(peaks):
            if one.actions + one.held_out_actions != actions[number % len(actions)]:
                raise ValueError("a peak of another subject")
        return starts, peaks
