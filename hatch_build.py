"""How hatchling puts the lessons into a wheel: without outputs, which would be a quarter of it."""

from __future__ import annotations

import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class LessonsWithoutOutputs(BuildHookInterface[Any]):
    """Adds all notebooks to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the notebooks as they are to be and name them for the wheel."""
        if version == "editable":
            return
        root = Path(self.root)
        strip = runpy.run_path(str(root / "causal_openlock/files/notebooks.py"))["without_outputs"]
        self.folder = tempfile.TemporaryDirectory()
        for path in (root / "notebooks").glob("*.ipynb"):
            written = Path(self.folder.name, path.name)
            written.write_text(strip(path.read_text(encoding="utf-8")), encoding="utf-8")
            build_data["force_include"][str(written)] = (
                f"causal_openlock/bundled/notebooks/{path.name}"
            )

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was written."""
        if version != "editable":
            self.folder.cleanup()
