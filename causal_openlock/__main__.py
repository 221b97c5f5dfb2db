"""``python -m causal_openlock`` is the command line."""

from causal_openlock.cli import main

if __name__ == "__main__":
    main()
