"""Many growing maps that learn from as many streams in one call: seeds, thresholds, robots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import cast

from torch import Tensor, nn

from pacnet.attention.records import Attention, Observation
from pacnet.attention.sofm import HabituatingSOFM
from pacnet.kernels.threads import in_threads


class SOFMEnsemble(nn.Module):
    """B independent maps, each with its own config, side by side in as many threads as torch uses.

    Each map learns what it would learn alone, bit for bit. On the CPU the compiled kernels release
    Python's global lock, so that the threads share the cores. On another device the eager engine
    runs, one map after the other in each thread; that has not been tried on a GPU.

    Args:
        maps: the maps; they are shared with the caller.

    Raises:
        ValueError: no map, one of them twice, or something else.

    Example:
        >>> maps = [HabituatingSOFM(SOFMConfig.paper(2, novelty_threshold=t)) for t in (0.2, 0.8)]
        >>> records = SOFMEnsemble(maps).observe(torch.rand(2, 500, 2))
        >>> len(maps[0]) < len(maps[1])
        True
    """

    def __init__(self, maps: Iterable[HabituatingSOFM]) -> None:
        super().__init__()
        members = list(maps)
        for member in members:
            if not isinstance(member, HabituatingSOFM):
                raise ValueError(f"expected HabituatingSOFMs, got {type(member).__name__}")
        if not members or len({id(sofm) for sofm in members}) < len(members):
            raise ValueError(f"expected one or more different maps, got {len(members)}")
        self.maps = nn.ModuleList(members)

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.maps)

    def forward(self, percepts: Tensor | Sequence[Tensor]) -> list[Attention]:
        """Read every map; see `HabituatingSOFM.forward`.

        Args:
            percepts: a stream for each map, `[B, T, D]`, or a sequence of B tensors `[T, D]`.

        Raises:
            ValueError: not a stream for each map, or one that its map refuses.
        """
        return [sofm(stream) for sofm, stream in self._pairs(percepts)]

    def observe(self, percepts: Tensor | Sequence[Tensor]) -> list[Observation]:
        """Let every map learn its stream; see `HabituatingSOFM.observe`.

        Args:
            percepts: a stream for each map, `[B, T, D]`, or a sequence of B tensors `[T, D]`, whose
                lengths may differ.

        Raises:
            ValueError: not a stream for each map, or one that its map refuses; nothing has been
                learned then.
        """
        pairs = self._pairs(percepts)
        for sofm, stream in pairs:
            sofm.normalize(stream)  # refuses a bad stream before any map learns
        return in_threads(lambda pair: pair[0].observe(pair[1]), pairs)

    def _pairs(self, percepts: Tensor | Sequence[Tensor]) -> list[tuple[HabituatingSOFM, Tensor]]:
        """Return each map with its stream."""
        is_batch = isinstance(percepts, Tensor) and percepts.dim() > 0
        if not isinstance(percepts, Sequence) and not is_batch:
            raise ValueError(f"expected a stream for each map, got {percepts!r}")
        if len(percepts) != len(self):
            raise ValueError(f"expected a stream for each of {len(self)} maps, got {len(percepts)}")
        return list(zip(cast(Iterable[HabituatingSOFM], self.maps), percepts, strict=True))
