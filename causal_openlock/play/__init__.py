"""Play: people in the rooms that learners play, in a browser.

A small server (:mod:`~causal_openlock.play.server`, standard library only) hands out one page and
answers its clicks. Each person walks through a condition in a
:class:`~causal_openlock.experiment.session.Session` of their own
(:mod:`~causal_openlock.play.game`), so that what they see, what they may do and what is recorded is
what it is for a learner; schema, layout and solutions never leave the server. Every accepted click
is on file before it is answered (:mod:`~causal_openlock.play.log`), and a server that is started
again goes through that file and is where the last one was (:mod:`~causal_openlock.play.people`).
"""

from causal_openlock.play.people import People
from causal_openlock.play.reactions import read_reactions
from causal_openlock.play.server import PlayServer

__all__ = ["People", "PlayServer", "read_reactions"]
