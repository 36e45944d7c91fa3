import importlib.util
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mvmatch.confidence import EVIDENCE, ErrorModel, default_error_model, evidence, expected_error
from mvmatch.testing.fields import field_from_rows

pytest.importorskip("cv2")
pytest.importorskip("pycolmap")


@pytest.fixture(scope="module")
def tool():
    path = Path(__file__).parents[2] / "tools" / "fit_error_model.py"
    spec = importlib.util.spec_from_file_location("fit_error_model", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TRUE = ErrorModel(weights=(-1.0, 0.6, 0.5, -0.1, 0.4, -0.1), scale=0.4)


def sample(rng, count, weights=TRUE.weights):
    x = np.column_stack([np.ones(count), rng.normal(0.0, 0.5, (count, 5))])
    return x, np.exp(x @ np.array(weights) + rng.logistic(0.0, TRUE.scale, count))


def test_a_known_model_is_found_again(tool):
    rng = np.random.default_rng(0)
    found = tool.fit_error_model([sample(rng, 20_000), sample(rng, 5_000)])

    np.testing.assert_allclose(found.weights, TRUE.weights, atol=0.03)
    assert found.scale == pytest.approx(TRUE.scale, abs=0.02)


def test_a_long_stream_has_no_more_say_than_a_short_one(tool):
    rng = np.random.default_rng(0)
    larger = (0.0, *TRUE.weights[1:])
    found = tool.fit_error_model([sample(rng, 50_000), sample(rng, 5_000, larger)])
    assert found.weights[0] == pytest.approx(-0.5, abs=0.05)


def test_a_hidden_target_counts_as_far_off_and_not_as_infinitely_far(tool):
    rng = np.random.default_rng(0)
    x, error = sample(rng, 1000)
    hidden = np.where(np.arange(1000) < 10, np.inf, error)
    far = np.where(np.arange(1000) < 10, 8.0, error)
    assert tool.fit_error_model([(x, hidden)]) == tool.fit_error_model([(x, far)])


def test_the_file_of_a_model_names_every_piece_of_evidence_and_its_source(tool):
    text = tool.to_toml(TRUE, "two sequences")
    assert text.startswith("# Made by tools/fit_error_model.py from two sequences.\n")
    assert tomllib.loads(text) == {
        "scale": 0.4,
        "weights": dict(zip(EVIDENCE, TRUE.weights, strict=True)),
    }


def test_the_evidence_is_what_the_expected_errors_are_made_from():
    rng = np.random.default_rng(0)
    blocks = [[8 * i, 8 * j, 8, 8] for j in range(5) for i in range(5)]
    vectors = rng.normal(2.0, 0.5, (len(blocks), 2))
    rows = [(block, tuple(mv), 0) for block, mv in zip(blocks, vectors, strict=True)]
    field = field_from_rows(1, rows)
    field.residual[:] = rng.integers(0, 50, len(blocks))
    log_error = evidence(field) @ default_error_model().weights
    np.testing.assert_allclose(np.exp(log_error), expected_error(field), rtol=1e-4)
    lonely = field_from_rows(1, rows[:2])
    assert not np.isfinite(evidence(lonely)).all(axis=1).any()
