"""Settings of competing schemas: they also take and answer the names of the last release."""

from dataclasses import asdict, replace
from typing import Any

import pytest

from pacnet import CompetingSchemas, CompetingSchemasConfig, RecognitionConfig

OLD_FIELDS = {
    "alike_above": ("same_schema_similarity", 0.5),
    "continuation": ("lookahead_samples", 7),
    "worse_by": ("max_quality_drop", 0.125),
    "places": ("n_states", 16),
    "width": ("obs_std", 0.25),
    "mismatch": ("outlier_likelihood", 0.01),
    "restart": ("restart_prob", 0.002),
}


def make(field: str, value: Any) -> CompetingSchemasConfig | RecognitionConfig:
    new = OLD_FIELDS.get(field, (field,))[0]
    is_recognition = hasattr(RecognitionConfig(), new)
    fields: dict[str, Any] = {field: value}
    return RecognitionConfig(**fields) if is_recognition else CompetingSchemasConfig(1, 2, **fields)


@pytest.mark.parametrize("old", OLD_FIELDS)
def test_an_old_field_warns_and_sets_the_new_one(old: str):
    new, value = OLD_FIELDS[old]
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}$"):
        config = make(old, value)
    assert config == make(new, value)
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}$"):
        assert getattr(config, old) == value
    assert old not in asdict(config)
    assert replace(config, **{new: value}) == config


def test_the_passes_of_schemas_are_their_visits():
    schemas = CompetingSchemas(CompetingSchemasConfig(1, 2))
    with pytest.warns(DeprecationWarning, match="^passes is now visits$"):
        assert schemas.passes is schemas.visits


@pytest.mark.parametrize(
    "fields", [{}, {"margin": 0.25, "recognition": RecognitionConfig(n_states=16)}]
)
def test_a_config_comes_back_from_its_fields(fields: dict[str, Any]):
    config = CompetingSchemasConfig(1, 2, **fields)
    given = asdict(config)
    assert isinstance(given["recognition"], dict)
    assert CompetingSchemasConfig(**given) == config
