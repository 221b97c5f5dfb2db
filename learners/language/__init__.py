"""What the learner ``llm`` stands on.

=========== ========================================================================
``answers`` The tools a model is offered, and what its answers mean.
``server``  Requests to a server that has the OpenAI-compatible chat interface.
``replay``  The replies that were given before, by all that they depend on.
=========== ========================================================================
"""
