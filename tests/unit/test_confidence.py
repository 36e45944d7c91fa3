import dataclasses

import numpy as np
import pytest

from mvmatch.confidence import ErrorModel, default_error_model, expected_error
from mvmatch.testing.fields import field_from_rows

BLOCKS = [[8 * column, 8 * line, 8, 8] for line in range(4) for column in range(8)]


def smooth_field(jitter=0.0):
    rng = np.random.default_rng(0)
    vectors = np.array([2.0, 1.0]) + jitter * rng.standard_normal((len(BLOCKS), 2))
    return field_from_rows(1, [(b, tuple(v), 0) for b, v in zip(BLOCKS, vectors, strict=True)])


def test_half_of_the_vectors_are_nearer_than_their_expected_error():
    model = default_error_model()
    np.testing.assert_allclose(model.confidence([0.2, 0.7], bound=0.2)[0], 0.5)
    assert model.confidence(0.2, 0.4) > 0.8


def test_confidence_falls_with_the_error_and_is_nothing_for_an_unknown_one():
    values = ErrorModel(weights=(0.0,) * 6, scale=0.4).confidence([0.0, 0.1, 1.0, 9.0, np.inf])
    assert np.all(np.diff(values) < 0)
    assert (values[0], values[-1]) == (1.0, 0.0)


def test_vectors_that_disagree_are_expected_to_be_farther_off():
    smooth, rough = expected_error(smooth_field()), expected_error(smooth_field(jitter=1.0))
    assert np.all(smooth < 0.1)
    assert np.median(rough) > 5 * np.median(smooth)


def test_what_the_prediction_left_over_counts_against_a_vector():
    field = smooth_field(jitter=0.2)
    coded = dataclasses.replace(field, residual=np.full(len(field), 40.0, np.float32))
    assert np.all(expected_error(coded) > expected_error(field))


def test_a_field_without_rows_has_no_errors():
    assert expected_error(field_from_rows(1, [])).shape == (0,)


def test_columns_of_different_length_are_refused():
    field = dataclasses.replace(smooth_field(), residual=np.zeros(3, np.float32))
    with pytest.raises(ValueError, match="one row each"):
        expected_error(field)
