"""The page docs/benchmarks.md: scores on data that other people recorded."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"

INTRO = """# Benchmarks

How well pacnet acts on data that other people recorded, beside baselines that anybody could write
in ten lines. Each part names the command that measures it; with `--write`, the command writes the
part. The page about speed is [performance.md](performance.md).
"""


def update(name: str, text: str) -> None:
    """Write a part into the page, in place of an earlier one of that name or at the end.

    Args:
        name: of the part.
        text: Markdown.

    Raises:
        ValueError: the page has only the beginning or only the end of the part.
    """
    page = PAGE.read_text("utf-8") if PAGE.exists() else INTRO
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    part = f"{begin}\n{text.strip()}\n{end}"
    earlier = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    changed, count = earlier.subn(lambda _: part, page)
    if not count and (begin in page or end in page):
        raise ValueError(f"expected {begin!r} and then {end!r} in {PAGE.name}, got one alone")
    PAGE.write_text(changed if count else f"{page.rstrip()}\n\n{part}\n", "utf-8")
