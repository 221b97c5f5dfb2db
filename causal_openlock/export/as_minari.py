"""The record as a Minari data set, for offline reinforcement learning.

An episode is a whole trial or a single attempt, as in
:class:`~causal_openlock.envs.OpenLockEnv`: within a trial, what is seen after an attempt is the
room put back. Observations and rewards are not on record; they are what the recorded actions lead
to when they are carried out once more (:mod:`causal_openlock.export.replay`). Who played what is
in the metadata of each episode. What subjects were shown is left out.
"""

from __future__ import annotations

import copy
import importlib.util
import re
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import Condition, LearnerSpec
from causal_openlock.experiment.record import played
from causal_openlock.export.replay import Steps, replay, trial_numbers
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.version import __version__
from causal_openlock.wording import nearest
from causal_openlock.world.reward_code import OwnReward
from causal_openlock.world.room import positions_for

if TYPE_CHECKING:
    from causal_openlock.storage.store import Store

EPISODES = ("trial", "attempt")
KEPT = ("learner", "condition", "protocol", "subject", "phase", "loop", "trial", "schema", "layout")
"""Columns of the record that are kept with every episode."""


def write_minari(
    store: Store,
    out: Path | str,
    *,
    episodes: str = "trial",
    learners: Sequence[str] = (),
    conditions: Sequence[str] = (),
) -> tuple[Path, int]:
    """Write the record of a results folder as a Minari data set.

    Args:
        store: The results folder.
        out: A folder of Minari data sets, such as ``MINARI_DATASETS_PATH`` names.
        episodes: ``trial`` or ``attempt``.
        learners: Labels of the learners to take; by default all.
        conditions: Names of the conditions to take; by default all.

    Returns:
        The folder of the data set, called after the experiment, and how many episodes it has.

    Raises:
        OpenLockError: If a package is missing, the data set is there already, or cannot be written.
        StoreError: If there is no cell, one is damaged, or its replay differs from the record.
    """
    require_minari()
    from gymnasium import spaces
    from minari.dataset.minari_storage import MinariStorage

    experiment = store.experiment()
    specs: dict[str, LearnerSpec] = _chosen(experiment.learners, learners, "learner")
    among: dict[str, Condition] = _chosen(experiment.conditions, conditions, "condition")
    for spec in specs.values():
        if isinstance(spec.reward, OwnReward):  # results may be somebody else's: it does not run
            raise OpenLockError(
                f"what each action of {spec.name} was paid is decided by {spec.reward.name}, code "
                "that an export does not run; choose others with --learner, or export to CSV"
            )
    positions = {name: max(map(positions_for, one.schemas)) for name, one in among.items()}
    if len(set(positions.values())) > 1:
        numbers = ", ".join(f"{name} {number}" for name, number in positions.items())
        raise OpenLockError(
            f"all rooms of a data set need the same number of positions, and these differ "
            f"({numbers}); choose some of them with --condition"
        )
    (width,) = set(positions.values())
    label = f"{re.sub(r'[^A-Za-z0-9_-]+', '-', experiment.name)}-{episodes}-v0"
    folder = Path(out) / label
    if folder.exists():
        raise OpenLockError(f"{folder} is there already; remove it, or choose another folder")
    # Half a data set looks like a whole one, so it has another name until it is whole.
    partial = folder.with_name(f".{label}.unfinished")
    data = partial / "data"
    try:
        if partial.exists():  # of an export that was killed
            shutil.rmtree(partial)
        data.mkdir(parents=True)
        storage = MinariStorage.new(
            data.resolve(),
            observation_space=spaces.MultiBinary(2 * width + 2),
            action_space=spaces.Discrete(2 * width + 1),
            env_spec=_environment(specs.values(), among.values(), episodes, width),
        )
        metadata: list[dict[str, Any]] = []
        storage.update_episodes(_episodes(store, specs, among, episodes, metadata))
        if metadata:
            storage.update_episode_metadata(metadata)
        storage.update_metadata(
            {
                "dataset_id": label,
                "minari_version": version("minari"),
                "algorithm_name": ", ".join(specs),
                "description": experiment.title or experiment.name,
                "requirements": [f"causal-openlock=={__version__}"],
            }
        )
        if metadata:
            partial.rename(folder)
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        if isinstance(error, OSError):
            raise OpenLockError(
                f"{folder}: cannot be written ({error.strerror or error}); free some space or "
                "choose another folder"
            ) from None
        raise
    if not metadata:
        shutil.rmtree(partial, ignore_errors=True)
        raise StoreError(f"{store.folder} has no cells of this choice; run compare to the end")
    return folder, len(metadata)


def require_minari() -> None:
    """Make sure that the packages that write data sets are installed."""
    missing = [name for name in ("minari", "h5py") if importlib.util.find_spec(name) is None]
    if missing:
        raise OpenLockError(
            f"a Minari data set needs {' and '.join(missing)}; install what is missing with: "
            "pip install 'causal-openlock[minari]'"
        )


def _chosen(listed: Sequence[Any], names: Sequence[str], what: str) -> dict[str, Any]:
    known = {one.name: one for one in listed}
    for name in names:
        if name not in known:
            raise OpenLockError(f"there is no {what} {name!r} here; {nearest(name, known)}")
    return {name: one for name, one in known.items() if not names or name in names}


def _episodes(
    store: Store,
    specs: Mapping[str, LearnerSpec],
    conditions: Mapping[str, Condition],
    kind: str,
    metadata: list[dict[str, Any]],
) -> Iterator[Any]:
    """The episodes of the chosen cells; the metadata of each is appended to a list."""
    from minari.data_collector import EpisodeBuffer

    for path in store.files()[0]:
        record = played(store.read(path))
        if not record.num_rows:
            continue
        spec = specs.get(record["learner"][0].as_py())
        condition = conditions.get(record["condition"][0].as_py())
        if spec is None or condition is None:
            continue
        steps = replay(record, condition, spec.protocol, spec.reward)
        number = trial_numbers(record) if kind == "trial" else np.arange(record.num_rows)
        starts = np.flatnonzero(np.diff(number, prepend=-1))
        rows = record.select([*KEPT, "attempt"]).take(starts).to_pylist()
        found, most, new = (
            record[name].to_numpy() for name in ("solutions_found", "solutions", "new_solution")
        )
        ends = np.append(starts[1:], record.num_rows)
        for row, begin, end in zip(rows, starts, ends, strict=True):
            solved = bool(found[end - 1] == most[end - 1])
            if kind == "trial":
                del row["attempt"]
            news = int(np.count_nonzero(new[begin:end]))
            metadata.append({**row, "new_solutions": news, "solved": solved})
            over = kind == "attempt" or (solved and spec.protocol.stop_when_solved)
            yield EpisodeBuffer(**_buffer(steps, slice(begin, end), over, kind == "trial"))


def _buffer(steps: Steps, which: slice, terminated: bool, put_back: bool) -> dict[str, Any]:
    """The attempts of an episode in a row; a room may be put back after each attempt."""
    used, begins, seen = steps.used[which], steps.begins[which], steps.seen[which]
    if put_back:
        seen = seen.copy()
        seen[np.arange(len(used)), used - 1] = begins
    taken = np.arange(steps.actions.shape[1]) < used[:, None]
    rewards = steps.rewards[which][taken]
    last, never = np.arange(len(rewards)) == len(rewards) - 1, np.zeros(len(rewards), bool)
    return {
        "observations": np.concatenate([begins[:1], seen[taken]]),
        "actions": steps.actions[which][taken],
        "rewards": rewards,
        "terminations": last if terminated else never,
        "truncations": never if terminated else last,
        "infos": {},
    }


def why_no_environment(store: Store, episodes: str, learners: Sequence[str] = ()) -> str | None:
    """Reason why ``recover_environment()`` of a data set of these learners fails, or ``None``."""
    specs = _chosen(store.experiment().learners, learners, "learner")
    going_on = [name for name, one in specs.items() if not one.protocol.stop_when_solved]
    if episodes == "trial" and going_on:
        return (
            f"trials of {', '.join(going_on)} continue after they are solved, and an environment's "
            "do not; export attempts, or choose learners with --learner"
        )
    return None


def _environment(
    specs: Collection[LearnerSpec],
    conditions: Collection[Condition],
    episodes: str,
    positions: int,
) -> Any:
    """The environment in which the episodes were played, if there is one."""
    import gymnasium

    if episodes == "trial" and not all(spec.protocol.stop_when_solved for spec in specs):
        return None
    known = bundled_schemas()
    rooms: list[dict[str, Any]] = []
    for spec in specs:
        for schema in dict.fromkeys(
            trials.schema
            for one in conditions
            for trials in (*(() if one.shown else one.train), *one.test)
        ):
            room = {
                "schema": schema.name if known.get(schema.name) == schema else schema.as_dict(),
                "reward": spec.reward.written(),
                "episode": episodes,
                "attempt_limit": spec.protocol.attempt_limit,
                "action_limit": spec.protocol.action_limit,
                "positions": positions,
            }
            if room not in rooms:
                rooms.append(room)
    if len(rooms) == 1:
        # A copy: the registry's own would be changed for everybody.
        environment = copy.deepcopy(gymnasium.spec("causal_openlock/OpenLock-v0"))
        environment.kwargs = rooms[0]
    else:
        environment = copy.deepcopy(gymnasium.spec("causal_openlock/MixedRooms-v0"))
        environment.kwargs = {"rooms": rooms}
    return environment
