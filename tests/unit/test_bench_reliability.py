import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")
pytest.importorskip("pycolmap")

from mvmatch.bench.front_ends import ABLATIONS, FRONT_ENDS
from mvmatch.bench.reliability import ReliabilityOptions, Stream, rate, streams, vector_errors
from mvmatch.bench.reliability_report import reliability_table, write_reliability
from mvmatch.bench.truth import StillTruth
from mvmatch.errors import DataError
from mvmatch.testing.fields import field_from_rows
from mvmatch.tracks import TrackOptions


def drawn(confidence, rng):
    """Errors that are below 1 px as often as the confidence says."""
    return np.where(rng.random(len(confidence)) < confidence, 0.5, 3.0)


def test_confidences_that_are_kept_have_no_calibration_error():
    rng = np.random.default_rng(0)
    confidence = rng.random(100_000)
    assert rate(drawn(confidence, rng), confidence).calibration_error < 0.01


def test_confidences_that_promise_too_much_have_one():
    rng = np.random.default_rng(0)
    confidence = rng.random(10_000)
    rated = rate(drawn(confidence, rng), np.minimum(confidence + 0.2, 1.0))
    assert rated.calibration_error == pytest.approx(0.18, abs=0.02)
    assert rated.confidence - rated.hits == pytest.approx(0.18, abs=0.02)


def test_the_confident_half_is_the_half_with_the_higher_confidences():
    rated = rate([0.1, 9.0, np.inf, 0.3], [0.9, 0.1, 0.2, 0.8])
    assert (rated.gross, rated.gross_confident) == (0.5, 0.0)
    assert (rated.count, rated.hits) == (4, 0.5)


def test_a_confidence_of_one_belongs_to_the_last_bin():
    rated = rate([0.1, 0.1], [1.0, 0.95])
    assert [each.count for each in rated.bins] == [2]


def test_nothing_to_rate_is_refused():
    with pytest.raises(ValueError, match="no vectors"):
        rate([], [])


@dataclasses.dataclass
class StillSequence:
    """Three pictures of the same thing."""

    name = "still"
    truth: object

    def __len__(self):
        return 3


def test_errors_are_those_of_the_fused_vectors_against_the_truth():
    blocks = [[8 * i, 8 * j, 8, 8] for j in range(4) for i in range(4)]
    near = field_from_rows(0, [(block, (0.5, 0.0), 1) for block in blocks])
    outside = field_from_rows(0, [(blocks[0], (0.5, 0.0), 7)])
    skipped = dataclasses.replace(near, frame=1)
    sequence = StillSequence(StillTruth((32, 32)))
    found = [errors for _, errors in vector_errors([near, outside, skipped], sequence)]

    np.testing.assert_allclose(found[0], 0.5, atol=1e-5)
    assert np.isnan(found[1]).all()
    assert len(found) == 2


def test_a_sequence_without_point_truth_is_refused():
    with pytest.raises(DataError, match="no point truth"):
        list(vector_errors([], StillSequence(None)))


def test_encoders_that_are_not_known_are_refused(tmp_path):
    (tmp_path / "images").mkdir()
    options = ReliabilityOptions(data=(tmp_path,), out=tmp_path, encoders=("magic",))
    with pytest.raises(DataError, match="no encoder magic; there are svt"):
        list(streams(options))


def test_the_report_names_both_halves_and_has_a_diagram(tmp_path):
    rng = np.random.default_rng(0)
    confidence = rng.random(2000)
    rated = rate(drawn(confidence, rng), confidence)
    results = [
        (Stream(sequence="a", half="reporting", encoder="svt", quality=None), rated),
        (Stream(sequence="b", half="reporting", encoder="svt", quality=45), rated),
        (Stream(sequence="c", half="tuning", encoder="libaom-rt", quality=None), rated),
    ]
    text = reliability_table(results)
    assert "| reporting | mean of 2 streams |" in text
    assert "| tuning | c | libaom-rt | default |" in text
    options = ReliabilityOptions(data=(tmp_path,), out=tmp_path)
    assert [path.stat().st_size > 0 for path in write_reliability(results, options)] == [True] * 3


def test_every_ablation_changes_preset_default_and_is_a_method():
    for name, changes in ABLATIONS.items():
        changed = dataclasses.replace(TrackOptions(), **changes)
        assert changed != TrackOptions()
        assert FRONT_ENDS[f"svt-default-{name}"].track == changed
