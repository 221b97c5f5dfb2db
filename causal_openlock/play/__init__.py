"""Play: people in the rooms that learners play, in a browser.

A small web server (:mod:`~causal_openlock.play.server`) hands out one page and answers its clicks.
Each person walks through a condition in a :class:`~causal_openlock.experiment.session.Session` of
their own (:mod:`~causal_openlock.play.game`), so that what they see, what they may do and what is
recorded is what it is for a learner; schema, layout and solutions never leave the server. Every
accepted click is on file before it is answered (:mod:`~causal_openlock.play.log`), and a restarted
server reads that file and continues where the last one stopped
(:mod:`~causal_openlock.play.people`). None of these knows of the web. While people play,
a thread writes their record (:mod:`~causal_openlock.play.web`). From Python,
:mod:`~causal_openlock.play.background` opens a room while other code runs. Reaction times are
stored next to the record (:mod:`~causal_openlock.experiment.beside_record`); the page itself is in
``static/``.
"""
