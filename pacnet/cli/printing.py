"""Output: aligned tables, name-value pairs, JSON and progress bars."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from typing import Any

NOTHING = "–"  # printed for a missing value
_WIDEST = 40  # characters of a cell


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows under their heads; columns whose head starts with "<" are aligned left."""
    columns = [
        [head.removeprefix("<"), *_shortened(cells)]
        for head, *cells in zip(heads, *rows, strict=True)
    ]
    widths = [max(map(len, column)) for column in columns]
    for line in zip(*columns, strict=True):
        cells = [
            cell.ljust(width) if head.startswith("<") else cell.rjust(width)
            for head, cell, width in zip(heads, line, widths, strict=True)
        ]
        print("  ".join(cells).rstrip())


def print_pairs(pairs: Sequence[tuple[str, str]]) -> None:
    """Print names and their values, one pair a line."""
    width = max(len(name) for name, _ in pairs)
    for name, value in pairs:
        print(f"{name:<{width}}  {value}".rstrip())


def print_json(document: Any) -> None:
    """Print a document as JSON; NaN and infinity, which JSON lacks, become null."""
    print(json.dumps(_without_nan(document), indent=2, ensure_ascii=False))


@contextmanager
def progress_bar(doing: str, total: int, unit: str = "frame") -> Iterator[Callable[[int], object]]:
    """Show progress on stderr, if that is a terminal; yield a function to call with units done."""
    from tqdm import tqdm

    with tqdm(total=total, desc=doing, unit=unit, disable=None, leave=False) as bar:
        yield bar.update


def counted(count: int, noun: str) -> str:
    """Return a number with its noun: 1 node, 2 nodes."""
    return f"{count:,} {noun if count == 1 else noun + 's'}"


def size_text(size: int) -> str:
    """Return a number of bytes in kilobytes or megabytes."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def _shortened(cells: Sequence[str]) -> list[str]:
    """Return the cells of a column on one line each, long ones cut but still distinct."""
    cells = [" ".join(cell.split()) for cell in cells]
    long = sorted({cell for cell in cells if len(cell) > _WIDEST})
    half = _WIDEST // 2
    cut = {cell: f"{cell[:half]}…{cell[1 - half :]}" for cell in long}
    for text in set(cut.values()):
        same = [cell for cell in long if cut[cell] == text]
        if len(same) > 1:
            cut.update(zip(same, _distinct(same), strict=True))
    return [cut.get(cell, cell) for cell in cells]


def _distinct(cells: Sequence[str]) -> Sequence[str]:
    """Return the beginning of each cell and the words that differ; whole cells if too long."""
    words = [cell.split() for cell in cells]
    start = _common(words)
    rests = [part[start:] for part in words]
    end = _common([rest[:0:-1] for rest in rests])  # of all but the first word
    parts = [" ".join(rest[: len(rest) - end]) for rest in rests]
    free = _WIDEST - 2 - max(map(len, parts))
    if free < 1 or len(set(parts)) < len(cells):
        return cells
    beginning = " ".join(words[0][:start])[:free].rstrip()
    return [f"{beginning}…{part}…" for part in parts]


def _common(lines: Sequence[Sequence[str]]) -> int:
    """Return the number of words that all lines begin with."""
    return len(list(takewhile(lambda words: len(set(words)) == 1, zip(*lines, strict=False))))


def _without_nan(document: Any) -> Any:
    if isinstance(document, dict):
        return {name: _without_nan(value) for name, value in document.items()}
    if isinstance(document, list | tuple):
        return [_without_nan(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document
