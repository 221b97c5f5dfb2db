# The public API: every name that users import, and where it is defined. This is the one list of
# it; `causal_openlock/__init__.py` loads each name when it is first used, type checkers read it
# here, and docs/api/public.rst says what each is for.

# Schemas and rooms
from .envs.playable import room as room
from .schemas.declared import schema as schema
from .schemas.graphs import export_schema as export_schema
from .schemas.graphs import import_schema as import_schema
from .schemas.graphs import to_bayesian_network as to_bayesian_network
from .schemas.finding import bundled_schemas as bundled_schemas
from .schemas.finding import find_schema as find_schema
from .schemas.graphs import read_schema as read_schema
from .schemas.graphs import write_schema as write_schema
from .schemas.fsm import FSM as FSM
from .schemas.fsm import compile_schema as compile_schema
from .world.randomness import Streams as Streams
from .world.reward_table import Events as Events
from .world.reward_table import RewardTable as RewardTable
from .world.rewards import find_reward as find_reward
from .world.room import Layout as Layout
from .world.room import Room as Room
from .world.room import action_names as action_names
from .world.room import position_coordinates as position_coordinates
from .world.room import position_names as position_names
from .schemas.schema import Gate as Gate
from .schemas.schema import Schema as Schema
from .world.tables import RoomTables as RoomTables

# Learners
from .contract.learner import Brief as Brief
from .contract.learner import InformedLearner as InformedLearner
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
from .experiment.experiment import Experiment as Experiment
from .experiment.building import Changes as Changes
from .experiment.building import learner as learner
from .experiment.building import make_experiment as make_experiment
from .experiment.building import sweep as sweep
from .experiment.file import find_experiment as find_experiment
from .experiment.file import read_experiment as read_experiment
from .experiment.protocol import PROTOCOLS as PROTOCOLS
from .experiment.protocol import Condition as Condition
from .experiment.protocol import Protocol as Protocol
from .experiment.protocol import Trials as Trials
from .experiment.protocol import default_action_limit as default_action_limit
from .experiment.record import CATEGORIES as CATEGORIES
from .running.runner import run as run
from .experiment.session import Session as Session
from .storage.store import Store as Store

# Environments
from .envs.single import OpenLockEnv as OpenLockEnv
from .envs.text import OpenLockTextEnv as OpenLockTextEnv
from .envs.vector import OpenLockVectorEnv as OpenLockVectorEnv

# Beliefs
from .analysis.results.bounds import ideal_attempts as ideal_attempts
from .analysis.results.bounds import ideal_bounds as ideal_bounds
from .belief.likelihoods import takes_effect as takes_effect
from .belief.grammar import schema_classes as schema_classes
from .belief.planning import Situation as Situation
from .belief.trace import trace_trial as trace_trial
from .belief.worth import SchemaWorth as SchemaWorth
from .belief.worth import schema_worth as schema_worth

# Analysis
from .analysis.measures import attempts_to_solve as attempts_to_solve
from .analysis.measures import category_counts as category_counts
from .analysis.plots.attempts import plot_attempts as plot_attempts
from .analysis.plots.attempts import plot_transfer as plot_transfer
from .analysis.plots.belief import plot_beliefs as plot_beliefs
from .analysis.plots.belief import plot_trace as plot_trace
from .analysis.plots.categories import plot_categories as plot_categories
from .analysis.topics.congruency import congruency as congruency
from .analysis.topics.congruency import plot_congruency as plot_congruency
from .analysis.topics.pairwise import plot_pairs as plot_pairs
from .analysis.topics.savings import plot_savings as plot_savings
from .analysis.topics.learning_cost import plot_cost as plot_cost
from .analysis.plots.course import plot_course as plot_course
from .paper.knowledge import knowledge_steps as knowledge_steps
from .paper.knowledge import plot_knowledge_steps as plot_knowledge_steps
from .paper.likeness_figure import plot_likeness as plot_likeness
from .analysis.plots.style import PlotStyle as PlotStyle
from .analysis.plots.style import plot_style as plot_style
from .analysis.plots.subjects import plot_subjects as plot_subjects
from .analysis.topics.survival import plot_survival as plot_survival
from .analysis.plots.sweep import plot_sweep as plot_sweep
from .analysis.topics.structure_recovery import plot_structure_recovery as plot_structure_recovery
from .analysis.report.writing import write_report as write_report
from .analysis.topics.learning_cost import learning_costs as learning_costs
from .analysis.results.probe import probe_structure as probe_structure
from .paper.published import people as people
from .analysis.topics.leaderboard import leaderboard as leaderboard
from .analysis.results.references import Reference as Reference
from .comparison.former import plot_understanding as plot_understanding
from .comparison.former import standings as standings
from .comparison.former import understanding as understanding
from .comparison.former import waste as waste
from .analysis.results.summary import headline_table as headline_table
from .analysis.results.summary import summary_table as summary_table
from .analysis.topics.structure_recovery import structure_recovery as structure_recovery
from .analysis.topics.regret import regret as regret
from .analysis.sample_size import sample_size as sample_size
from .analysis.statistics import mean_interval as mean_interval
from .scoring.model_selection import select_models as select_models
from .scoring.scores import Scores as Scores

# Pictures, films and people
from .play.background import play_room as play_room
from .play.people import People as People
from .experiment.reactions import read_reactions as read_reactions
from .play.server import PlayServer as PlayServer
from .render.film import save_film as save_film
from .render.graph import draw_schema as draw_schema
from .render.panel import Panel as Panel
from .render.filmed_trial import play_trial as play_trial
from .render.room import draw_room as draw_room
from .render.watch import watch as watch

__version__: str
ENV_ID: str
MIXED_ID: str
