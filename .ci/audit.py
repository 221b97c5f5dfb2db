"""Known security advisories for the locked set: what `make audit` says, and how it ends.

It asks with pip-audit. That passes over a package for which its service has no answer, and reports
"no known vulnerabilities" if the service answers for none. Here that is said in one sentence, and
the exit status is not 0: 1 if there is an advisory, 3 if packages could not be audited.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

AUDIT = ["--no-deps", "--disable-pip", "--format", "json", "--progress-spinner", "off"]


def said(report: Any) -> tuple[str, int]:
    """What to say of pip-audit's report, and the exit status."""
    packages = report["dependencies"]
    skipped = [one["name"] for one in packages if "skip_reason" in one]
    lines = [
        f"{one['name']} {one['version']}: {advisory['id']}"
        + (f", mended in {', '.join(advisory['fix_versions'])}" if advisory["fix_versions"] else "")
        for one in packages
        for advisory in one.get("vulns", ())
    ]
    known = len(lines)
    if packages and len(skipped) == len(packages):
        return (
            "nothing was audited, as the advisory service of PyPI cannot be reached from here (it "
            f"answered for none of {len(packages)} packages); run make audit where it can be"
        ), 3
    if skipped:
        lines.append(f"not audited, as the advisory service has no answer: {', '.join(skipped)}")
    if not lines:
        lines.append(f"no advisory is known for any of {len(packages)} packages")
    return "\n".join(lines), 1 if known else 3 if skipped else 0


def main(pip_audit: str, locked: str) -> int:
    """Audit a file of requirements."""
    asked = [pip_audit, "-r", locked, *AUDIT]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    try:
        text, status = said(json.loads(done.stdout))
    except (ValueError, KeyError):
        last = (done.stderr.strip().splitlines() or ["it gave no reason"])[-1]
        text, status = (
            f"nothing was audited, as pip-audit failed for {Path(locked).name}: {last}",
            3,
        )
    print(text, file=sys.stderr if status else sys.stdout)
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
