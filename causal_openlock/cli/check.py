"""``causal-openlock check``: whether this installation plays as it should."""

from __future__ import annotations

from causal_openlock.cli.options import Workers
from causal_openlock.errors import OpenLockError


def check(workers: Workers = None) -> None:
    """Check this installation against stored results.

    A small experiment is played and compared with them.

    It takes about a minute. Exit status: 0 if all is as it should be, 1 if something is not.
    """
    from causal_openlock.comparison.checking import check_installation
    from causal_openlock.comparison.console import Terminal, plain_table
    from causal_openlock.comparison.progress_bar import shown

    console = Terminal()
    with shown("check", console) as show:
        checks, others = check_installation(warn=console.warn, progress=show, workers=workers)
    table = plain_table("learner", "compared", "expected", "found", "ok", left=5)
    for one in checks:
        style = None if one.ok else "bold red"
        table.add_row(*one[:4], "yes" if one.ok else "no", style=style)
    console.print_whole(table)
    wrong = len(checks) - sum(one.ok for one in checks)
    if not wrong:
        console.print_line("This installation is right.")
        return
    remedy = (
        f"the stored results are from {others}; install those versions, and check again"
        if others
        else "versions are the same; please report this table, your processor and system"
    )
    error = OpenLockError(f"{wrong} of {len(checks)} are not as expected; {remedy}")
    error.status = 1
    raise error
