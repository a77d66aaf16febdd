"""What is typical: a spread over replicates, read from a file and printed beside one run."""

import json
from pathlib import Path

import pytest

from train.common.summary import mean_and_std, summarise
from train.common.typical import beside, load_typical

SHIPPED = Path(__file__).parents[2] / "checkpoints"


def write(path: Path, replicates: int) -> Path:
    scores = [{"wf": 0.8 + 0.1 * place} for place in range(replicates)]
    document = {"command": "c", "seed": 20, "conditions": {"recall": summarise(scores)}}
    path.write_text(json.dumps(document))
    return path


def test_what_is_typical_stands_behind_the_score_with_its_seeds(tmp_path: Path):
    path = write(tmp_path / "metrics.json", 3)
    typical = load_typical(path, "conditions")
    assert typical is not None
    assert typical.about == f"mean ± std over 3 replicates, seeds 20 to 22, of {path}"
    own = summarise([{"wf": 0.5}])["wf"]
    known = typical.scores["recall"]["wf"]
    assert beside(own, known) == "0.50 (0.90 ± 0.10)"
    assert beside(own, known, digits=1, factor=100) == "50.0 (90.0 ± 10.0)"
    assert beside(own, None) == "0.50"


def test_nothing_is_typical_without_a_file_or_of_one_replicate(tmp_path: Path):
    assert load_typical(tmp_path / "nowhere.json", "conditions") is None
    assert load_typical(write(tmp_path / "metrics.json", 1), "conditions") is None


def test_a_file_without_the_summaries_is_refused(tmp_path: Path):
    path = write(tmp_path / "metrics.json", 2)
    with pytest.raises(ValueError, match=r"expected summaries under 'alone' in .*conditions"):
        load_typical(path, "alone")


def test_one_replicate_has_no_deviation():
    assert mean_and_std(summarise([{"wf": 0.25}])["wf"]) == "0.25"
    # Mean 0.5; deviations ±0.25, squares sum to 0.125 over n - 1 = 1.
    assert mean_and_std(summarise([{"wf": 0.25}, {"wf": 0.75}])["wf"], 3) == "0.500 ± 0.354"


@pytest.mark.parametrize(
    ("file", "key"),
    [("postural_imitation/alone.json", "alone"), ("wall_following/metrics.json", "conditions")],
)
def test_the_shipped_scores_say_what_is_typical(file: str, key: str):
    typical = load_typical(SHIPPED / file, key)
    assert typical is not None
    assert typical.about.startswith("mean ± std over ")
