"""The names of this package; each is loaded when it is first used."""

from .learner_contract import LearnerContract as LearnerContract
from .strategies import layouts as layouts
from .strategies import schemas as schemas
