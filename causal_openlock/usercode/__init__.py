"""Code that users bring: learners and rewards of a notebook, of a script, or of files of their own.

- :mod:`~causal_openlock.usercode.own_files`: the files that it is made of, and their hash.
- :mod:`~causal_openlock.usercode.session_code`: classes that no file has, made in a session.
"""
