"""What a dataset's files contradict or lack, as lines on stderr."""

from __future__ import annotations

import sys
import warnings
from typing import Any


def show_notes() -> None:
    """Print each `DatasetWarning` from now on as a line `note: ...`, once, not as a warning.

    Other warnings stay as they are. The caller's `warnings.catch_warnings` ends it.
    """
    from pacnet.datasets.format import DatasetWarning

    usual, told = warnings.showwarning, set[str]()

    def show(message: Warning | str, category: type[Warning], *where: Any, **named: Any) -> None:
        if not issubclass(category, DatasetWarning):
            usual(message, category, *where, **named)
            return
        text = " ".join(str(message).split())
        if text not in told:
            told.add(text)
            print(f"note: {text}", file=sys.stderr)

    warnings.simplefilter("always", DatasetWarning)
    warnings.showwarning = show
