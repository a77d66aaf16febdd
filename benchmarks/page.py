"""The page docs/performance.md: the tables of every module, machine and versions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"

INTRO = """# Performance

How fast pacnet learns and recalls, compared with a C loop that does the same and with other Python
libraries. `python -m benchmarks` measures everything and writes this page;
`python -m benchmarks.NAME` measures one part of it. Both need a clone; the other libraries come
with `pip install -e '.[benchmarks]'`.

Runs are interleaved in one process, so background load affects all alike; a time is the median of
the runs. The ratios should hold elsewhere, the times belong to the machine at the end of the page.
The columns `wanted` hold the goals that were set before the measurement.
"""

MACHINE = "## Machine and versions"
_PART = re.compile(r"<!-- (\w+) -->\n(.*?)\n<!-- end of \1 -->", re.DOTALL)


def compose(parts: Mapping[str, str], machine: str) -> str:
    """Return the page.

    Args:
        parts: Module -> Markdown of its tables.
        machine: Description of the machine, a Markdown list.
    """
    drawn = [f"<!-- {name} -->\n{part}\n<!-- end of {name} -->" for name, part in parts.items()]
    return "\n\n".join([INTRO.rstrip(), *drawn, f"{MACHINE}\n\n{machine}"]) + "\n"


def parts_of(page: str, machine: str) -> dict[str, str]:
    """Return the parts of an earlier page; none if the machine or versions differ."""
    if not page.endswith(f"{MACHINE}\n\n{machine}\n"):
        return {}
    return dict(_PART.findall(page))


def update(measured: Mapping[str, str], order: tuple[str, ...], machine: str) -> None:
    """Write measurements into the page; other parts stay if machine and versions are the same."""
    earlier = parts_of(PAGE.read_text("utf-8"), machine) if PAGE.exists() else {}
    parts = earlier | dict(measured)
    PAGE.write_text(compose({n: parts[n] for n in order if n in parts}, machine), "utf-8")
