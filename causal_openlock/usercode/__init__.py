"""Code that users bring: learners and rewards of a notebook, a script, or their own files."""
