# The public API: the names that notebooks and scripts use, and where each is defined. This is the
# one list of it; `causal_openlock/__init__.py` loads a name when it is first used, type checkers
# read it here, and docs/api/public.rst says what each is for. Whatever else the package has is
# imported from its module.

# Schemas and rooms
from .envs.playable import room as room
from .schemas.finding import schema as schema
from .schemas.graphs import export_schema as export_schema
from .schemas.finding import find_schema as find_schema
from .schemas.fsm import compile_schema as compile_schema
from .world.room import Layout as Layout
from .world.room import Room as Room
from .schemas.schema import Schema as Schema

# Learners
from .contract.learner import Brief as Brief
from .contract.learner import Learner as Learner
from .contract.learner import Step as Step
from .contract.learner import View as View
from .contract.one_subject import OneSubjectLearner as OneSubjectLearner
from .contract.registry import create as create
from .testing import LearnerContract as LearnerContract

# Comparisons
from .comparison.comparing import compare as compare
from .comparison.results import Results as Results
from .comparison.results import open_results as open_results

# Experiments
from .errors import OpenLockError as OpenLockError
from .experiment.making import learner as learner
from .experiment.making import make_experiment as make_experiment
from .experiment.making import sweep as sweep
from .experiment.making import find_experiment as find_experiment
from .experiment.making import read_experiment as read_experiment
from .experiment.protocol import PROTOCOLS as PROTOCOLS
from .experiment.condition import Condition as Condition
from .experiment.protocol import Protocol as Protocol
from .experiment.condition import Trials as Trials
from .experiment.condition import find_condition as find_condition
from .running.runner import run as run
from .experiment.session import Session as Session

# Beliefs
from .belief.grammar import schema_classes as schema_classes
from .belief.trace import trace_trial as trace_trial
from .belief.worth import schema_worth as schema_worth

# Analysis
from .analysis.plots.belief import plot_trace as plot_trace
from .paper.knowledge import knowledge_steps as knowledge_steps
from .paper.knowledge import plot_knowledge_steps as plot_knowledge_steps
from .analysis.plots.style import plot_style as plot_style
from .paper.published import people as people
from .analysis.sample_size import sample_size as sample_size

# Pictures, films and people
from .play.background import play_room as play_room, serve as serve
from .play.people import People as People
from .experiment.beside_record import read_reactions as read_reactions
from .render.watch import watch as watch

__version__: str
ENV_ID: str
