"""Aligned text: tables, and lists of what is what."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

NOTHING = "–"  # what has no value
_LONGEST = 40  # letters of a cell


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints rows under their heads.

    Args:
        heads: of the columns; those that start with "<" are set flush left, the others right.
        rows: cells of each row.
    """
    columns = [
        [head.removeprefix("<"), *_shortened(cells)]
        for head, *cells in zip(heads, *rows, strict=True)
    ]
    lines = zip(*columns, strict=True)
    widths = [max(map(len, column)) for column in columns]
    for line in lines:
        cells = [
            cell.ljust(width) if head.startswith("<") else cell.rjust(width)
            for head, cell, width in zip(heads, line, widths, strict=True)
        ]
        print("  ".join(cells).rstrip())


def print_pairs(pairs: Iterable[tuple[str, str]]) -> None:
    """Prints what is what, one a line."""
    pairs = list(pairs)
    width = max(len(name) for name, _ in pairs)
    for name, told in pairs:
        print(f"{name:<{width}}  {told}".rstrip())


def print_json(document: Any) -> None:
    """Prints a document for machines; what is no number becomes null, as JSON has no NaN."""
    print(json.dumps(_without_nan(document), indent=2, ensure_ascii=False))


def counted(count: int, one: str) -> str:
    """A number with its noun: 1 node, 2 nodes."""
    return f"{count:,} {one if count == 1 else one + 's'}"


def size_of(folder: str | Path) -> int:
    """Bytes of the checkpoint in a folder."""
    from pacnet.core.checkpoint import CONFIG_FILE, TENSOR_FILE

    return sum((Path(folder) / name).stat().st_size for name in (CONFIG_FILE, TENSOR_FILE))


def size_text(folder: str | Path) -> str:
    """The same in kilobytes or megabytes."""
    size = size_of(folder)
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def over_tolerated(novelty: float | None) -> str:
    """A novelty, which is over what is tolerated; there is none for what came first."""
    return NOTHING if novelty is None else f"{novelty:.2f}"


def _shortened(cells: Sequence[str]) -> list[str]:
    """The cells of a column on one line each; long ones are cut, and can still be told apart."""
    cells = [" ".join(cell.split()) for cell in cells]
    long = sorted({cell for cell in cells if len(cell) > _LONGEST})
    cut = {cell: f"{cell[: _LONGEST // 2]}…{cell[1 - _LONGEST // 2 :]}" for cell in long}
    for looks in set(cut.values()):
        alike = [cell for cell in long if cut[cell] == looks]
        if len(alike) > 1:
            cut.update(zip(alike, _told_apart(alike), strict=True))
    return [cut.get(cell, cell) for cell in cells]


def _told_apart(cells: Sequence[str]) -> Sequence[str]:
    """The same, of which the beginning and the words that differ are left, if these fit."""
    words = [cell.split() for cell in cells]
    start = _same(words)
    end = _same([part[:start:-1] for part in words])
    parts = [" ".join(part[start : len(part) - end]) for part in words]
    room = _LONGEST - 2 - max(map(len, parts))
    if room < 1 or len(set(parts)) < len(cells):
        return cells
    shown = min(room, len(" ".join(words[0][:start])))
    return [f"{cell[:shown].rstrip()}…{part}…" for cell, part in zip(cells, parts, strict=True)]


def _same(lines: Sequence[Sequence[str]]) -> int:
    """How many words are the same at the beginning of all lines."""
    places = enumerate(zip(*lines, strict=False))
    differ = (place for place, words in places if len(set(words)) > 1)
    return next(differ, min(map(len, lines)))


def _without_nan(document: Any) -> Any:
    if isinstance(document, dict):
        return {name: _without_nan(value) for name, value in document.items()}
    if isinstance(document, list | tuple):
        return [_without_nan(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document
