"""Declares in a dataset what a checker finds in it and is meant to be so, with the reason.

The checker `rdq` reads `meta/rdq_expected.yaml`; what is declared there is no warning any more.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from pacnet.core.durable import write_atomically

PLACE = "meta/rdq_expected.yaml"


def expect_findings(
    dataset: Path, checks: str, reason: str, episodes: Sequence[int] | None = None
) -> None:
    """Declares the findings of a dataset, in place of any that were declared before.

    Args:
        dataset: its folder.
        checks: pattern of the checks' names, such as `episodes.spikes*`.
        reason: why it is so, in words.
        episodes: numbers of those that are meant; all if left out.
    """
    declared = {"checks": [checks], "reason": reason}
    if episodes is not None:
        declared["episodes"] = list(episodes)
    text = json.dumps([declared], indent=2, ensure_ascii=False)  # which is YAML as well
    write_atomically(dataset / PLACE, f"{text}\n".encode())
