"""Notebooks without what their cells put out: stored lessons have outputs, those given none."""

from __future__ import annotations

import json


def without_outputs(text: str) -> str:
    r"""Return a notebook as if it had never been run.

    Args:
        text: The notebook, as JSON.

    >>> cell = '{"cell_type": "code", "execution_count": 3, "outputs": [{}], "source": "1"}'
    >>> print(without_outputs('{"cells": [' + cell + '], "metadata": {}}'))
    {
     "cells": [
      {
       "cell_type": "code",
       "execution_count": null,
       "outputs": [],
       "source": "1"
      }
     ],
     "metadata": {}
    }
    <BLANKLINE>
    """
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            cell.update(execution_count=None, outputs=[])
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
