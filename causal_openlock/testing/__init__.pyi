"""The names of this package; each is loaded when it is first used."""

from .learner_contract import LearnerContract as LearnerContract
from .strategies import experiments as experiments
from .strategies import gates as gates
from .strategies import layouts as layouts
from .strategies import learners as learners
from .strategies import protocols as protocols
from .strategies import schemas as schemas
