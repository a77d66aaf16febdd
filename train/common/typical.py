"""What is typical: scores over replicates run before, printed beside those of a single new run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from train.common.summary import Summary, mean_and_std


@dataclass(frozen=True)
class Typical:
    """Scores over two or more replicates.

    Attributes:
        about: Says of what, as in "mean ± std over 3 replicates, seeds 30 to 32, of FILE".
        scores: Group (or condition) -> score -> its mean, deviation and values.
    """

    about: str
    scores: Mapping[str, Mapping[str, Summary]]


def load_typical(path: str | Path, key: str) -> Typical | None:
    """Read what is typical from a `metrics.json` of several replicates.

    Args:
        path: Of the file.
        key: Of its summaries, group by group.

    Returns:
        None if there is no such file, or if it holds one replicate alone.

    Raises:
        ValueError: The file has no summaries under this key.
    """
    if not Path(path).is_file():
        return None
    document = json.loads(Path(path).read_text())
    groups = document.get(key)
    if not groups:
        raise ValueError(f"expected summaries under '{key}' in '{path}', got {list(document)}")
    count = len(next(iter(next(iter(groups.values())).values()))["values"])
    if count < 2:
        return None
    first = document["seed"]
    last = first + count - 1
    about = f"mean ± std over {count} replicates, seeds {first} to {last}, of {path}"
    return Typical(about, groups)


def beside(own: Summary, typical: Summary | None, digits: int = 2, factor: float = 1.0) -> str:
    """Return a run's score as text, and behind it in brackets what is typical.

    Args:
        own: Of the run.
        typical: The same score over replicates run before; None where it is not known.
        digits: After the decimal point.
        factor: On all values, to show them in another unit.
    """
    text = mean_and_std(own, digits, factor)
    return text if typical is None else f"{text} ({mean_and_std(typical, digits, factor)})"
