"""Design of a study: which theories can be told apart, and in which conditions?

Nobody needs to be asked: subjects are simulated from theories, and theories predict them.
"""

COPIES = 128  #: most copies that are asked of a learner without probabilities
