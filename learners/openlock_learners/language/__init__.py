"""Modules behind the learner ``llm``.

=================== =================================================================
``offered_actions`` The tools a model is offered, and what its answers mean.
``server``          Requests to a server that has the OpenAI-compatible chat interface.
``side_by_side``    An event loop in a thread of its own, for requests at the same time.
``reply``           What a server said, read and checked.
``kept_replies``    The replies that were given before, by all that they depend on.
=================== =================================================================
"""
