"""Code that users bring: learners and rewards of a notebook, of a script, or of files of their own.

- :mod:`~causal_openlock.usercode.module_source`: where the file of a module is, with nothing run.
- :mod:`~causal_openlock.usercode.local_modules`: which modules of the user it imports.
- :mod:`~causal_openlock.usercode.code_digest`: a hash of all these.
- :mod:`~causal_openlock.usercode.session_code`: classes that no file has, made in a session.
- :mod:`~causal_openlock.usercode.misspelt`: what to say where a name is not found.

How such code goes to other machines stands in :mod:`causal_openlock.running.carried_code`.
"""
