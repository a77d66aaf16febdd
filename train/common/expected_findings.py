"""Declare which findings of the checker `rdq` are expected in a dataset, and why.

`rdq` reads `meta/rdq_expected.yaml` and does not warn about the findings declared there.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from pacnet.core.durable import write_atomically

FILE = "meta/rdq_expected.yaml"


def expect_findings(
    dataset: Path, checks: str, reason: str, episodes: Sequence[int] | None = None
) -> None:
    """Declare findings of a dataset as expected, replacing any that were declared before.

    Args:
        dataset: Its folder.
        checks: Pattern of the checks' names, such as `episodes.spikes*`.
        reason: Why they are expected, in words.
        episodes: Numbers of the episodes concerned; default all.
    """
    declared = {"checks": [checks], "reason": reason}
    if episodes is not None:
        declared["episodes"] = list(episodes)
    text = json.dumps([declared], indent=2, ensure_ascii=False)  # JSON is valid YAML
    write_atomically(dataset / FILE, f"{text}\n".encode())
