"""Many maps in one call: each learns what it would learn alone."""

import pytest
import torch

from pacnet import HabituatingSOFM, SOFMConfig, SOFMEnsemble


def streams(count: int, dimensions: int = 3) -> list[torch.Tensor]:
    """Return random walks of different lengths."""
    random = torch.Generator().manual_seed(0)
    return [
        torch.randn(100 + 20 * b, dimensions, generator=random).cumsum(0).mul(0.3)
        for b in range(count)
    ]


def maps(count: int, engine: str = "auto") -> list[HabituatingSOFM]:
    """Return maps with alternating presets and increasing thresholds."""
    presets = SOFMConfig.paper, SOFMConfig.gwr
    return [
        HabituatingSOFM(presets[b % 2](3, novelty_threshold=0.2 + 0.05 * b), engine)
        for b in range(count)
    ]


@pytest.fixture(params=[1, 2], ids=["one thread", "two threads"], autouse=True)
def _threads(request: pytest.FixtureRequest):
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_each_map_learns_what_it_would_learn_alone(engine: str):
    alone, together = maps(8, engine), maps(8, engine)
    ensemble = SOFMEnsemble(together)
    records = ensemble.observe(streams(8))
    for sofm, other, stream, record in zip(alone, together, streams(8), records, strict=True):
        assert all(map(torch.equal, sofm.observe(stream), record))
        state, same = sofm.state_dict(), other.state_dict()
        assert all(torch.equal(state[name], same[name]) for name in state)
    readings = ensemble(streams(8))
    for sofm, stream, reading in zip(alone, streams(8), readings, strict=True):
        assert all(map(torch.equal, sofm(stream), reading))
    assert len({len(sofm) for sofm in together}) > 4  # they differ


def test_streams_of_one_length_can_be_one_tensor():
    percepts = torch.randn(4, 50, 3, generator=torch.Generator().manual_seed(1))
    one, other = SOFMEnsemble(maps(4)), SOFMEnsemble(maps(4))
    for record, same in zip(one.observe(percepts), other.observe(list(percepts)), strict=True):
        assert all(map(torch.equal, record, same))


def test_a_bad_stream_is_refused_before_any_map_learns():
    ensemble, percepts = SOFMEnsemble(maps(3)), streams(3)
    percepts[2][5, 1] = torch.nan
    with pytest.raises(ValueError, match="expected finite percepts"):
        ensemble.observe(percepts)
    assert [len(sofm) for sofm in ensemble.maps] == [0, 0, 0]
    with pytest.raises(ValueError, match="a stream for each of 3 maps, got 2"):
        ensemble.observe(percepts[:2])


def test_eval_mode_freezes_all_maps():
    ensemble = SOFMEnsemble(maps(3)).eval()
    assert all(record.ignored.all() for record in ensemble.observe(streams(3)))
    assert [len(sofm) for sofm in ensemble.maps] == [0, 0, 0]


def test_an_ensemble_saves_and_loads_as_one():
    trained, other = SOFMEnsemble(maps(3)), SOFMEnsemble(maps(3))
    trained.observe(streams(3))
    other.load_state_dict(trained.state_dict())
    for sofm, loaded in zip(trained.maps, other.maps, strict=True):
        assert torch.equal(sofm.prototypes, loaded.prototypes)


def test_no_map_and_the_same_map_twice_are_refused():
    with pytest.raises(ValueError, match="one or more different maps, got 0"):
        SOFMEnsemble([])
    sofm = HabituatingSOFM(SOFMConfig.paper(3))
    with pytest.raises(ValueError, match="one or more different maps, got 2"):
        SOFMEnsemble([sofm, sofm])


def test_learning_in_an_ensemble_keeps_no_graph():
    ensemble = SOFMEnsemble(maps(2, "eager"))
    ensemble.observe([stream.requires_grad_() for stream in streams(2)])
    assert not any(buffer.requires_grad for buffer in ensemble.buffers())
