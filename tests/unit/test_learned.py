"""Learned matchers: the networks themselves with random weights, and what is said without them."""

from __future__ import annotations

import socket
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.bench.front_ends import Clip
from mvmatch.bench.protocol import run_protocol
from mvmatch.bench.protocol_methods import METHODS, LearnedMethod, Timeline, described
from mvmatch.bench.protocol_options import ProtocolOptions
from mvmatch.camera import parse_camera
from mvmatch.errors import DataError
from mvmatch.learned import LearnedFeatures, LightGlueModel, SuperGlueModel, read_rgb
from mvmatch.learned.lightglue import DETECTOR_WEIGHTS, MATCHER_WEIGHTS

if TYPE_CHECKING:
    from pathlib import Path

cv2 = pytest.importorskip("cv2")
pytest.importorskip("pycolmap")

LIGHTGLUE = ("disk", "aliked")
SHIFT = 32
"""px; a multiple of the strides of DISK."""


@pytest.fixture(autouse=True)
def offline(monkeypatch):
    """Nothing may be downloaded."""

    def refuse(*_):
        raise AssertionError("a test reached for the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)


@pytest.fixture(scope="module")
def torch():
    pytest.importorskip("kornia")
    return pytest.importorskip("torch")


@pytest.fixture(scope="module")
def checkpoints(torch, tmp_path_factory) -> Path:
    """A cache of PyTorch with random weights of DISK and ALIKED, and of LightGlue for both."""
    from kornia.feature import ALIKED, DISK

    home = tmp_path_factory.mktemp("torch")
    folder = home / "hub" / "checkpoints"
    folder.mkdir(parents=True)
    torch.manual_seed(0)
    torch.save({"extractor": DISK().state_dict()}, folder / "depth-save.pth")
    torch.save(ALIKED("aliked-n16").state_dict(), folder / "aliked-n16.pth")
    for features in LIGHTGLUE:
        torch.save(alike(torch, features), folder / f"{features}_lightglue_v0-1_arxiv-pth")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TORCH_HOME", str(home))
        yield folder


def alike(torch, features):
    """Weights of LightGlue, named as in its authors' files, that match the descriptors most alike.

    No layer changes the descriptors, which are turned at random and compared.
    """
    from kornia.feature import LightGlue

    network = LightGlue(None, **{**LightGlue.features[features], "weights": None})
    with torch.no_grad():
        for layer in network.transformers:
            for block in (layer.self_attn, layer.cross_attn):
                block.ffn[-1].weight.zero_()
                block.ffn[-1].bias.zero_()
        torch.nn.init.orthogonal_(network.input_proj.weight)
        network.input_proj.bias.zero_()
        for assignment in network.log_assignment:
            assignment.final_proj.weight.copy_(1000 * torch.eye(256))
            assignment.final_proj.bias.zero_()
            assignment.matchability.weight.zero_()
            assignment.matchability.bias.fill_(10.0)
    weights = {}
    for name, values in network.state_dict().items():
        parts = name.split(".")
        if parts[0] == "transformers":
            parts = [parts[2], parts[1], *parts[3:]]
        if name != "confidence_thresholds":
            weights[".".join(parts)] = values
    return weights


def texture(width: int = 256, height: int = 160) -> np.ndarray:
    generator = np.random.default_rng(0)
    noise = cv2.GaussianBlur(generator.uniform(0, 255, (height, width, 3)), (0, 0), 1.5)
    return ((noise - noise.mean()) * 5 + 128).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("features", LIGHTGLUE)
def test_weights_have_the_names_under_which_kornia_keeps_them(features, checkpoints):
    from kornia.feature import ALIKED, DISK, LightGlue

    _ = DISK.from_pretrained("depth") if features == "disk" else ALIKED.from_pretrained()
    LightGlue(features)
    paths = DETECTOR_WEIGHTS[features].path, MATCHER_WEIGHTS[features].path
    assert {path.parent for path in paths} == {checkpoints}


@pytest.mark.parametrize("features", LIGHTGLUE)
def test_weights_are_put_into_the_networks(features, checkpoints, torch):
    from kornia.feature import ALIKED, DISK, LightGlue

    ours = LightGlueModel(features=features).load()
    theirs = DISK.from_pretrained("depth") if features == "disk" else ALIKED.from_pretrained()
    for network, kornia in ((ours._detector, theirs), (ours._matcher, LightGlue(features))):
        stored = kornia.state_dict()
        assert network.state_dict().keys() == stored.keys()
        assert all(
            torch.equal(values, stored[name]) for name, values in network.state_dict().items()
        )


@pytest.mark.parametrize("features", LIGHTGLUE)
def test_features_match_themselves_and_count_from_the_corner_of_the_image(features, checkpoints):
    matcher = LightGlueModel(features=features, max_num_features=300).load()
    found = matcher.extract(texture())
    pairs = matcher.match(found, found)

    assert 100 < len(found.xy) <= 300
    assert found.xy.dtype == np.float32
    keypoints = found.tensors["keypoints"][0].cpu().numpy()
    np.testing.assert_allclose(found.xy, keypoints + 0.5, atol=1e-6)
    assert len(pairs) > 0.9 * len(found.xy)
    assert pairs.dtype == np.uint32
    np.testing.assert_array_equal(pairs[:, 0], pairs[:, 1])


def test_disk_finds_what_moved_where_it_moved_to(checkpoints):
    matcher = LightGlueModel(features="disk", max_num_features=500).load()
    image = texture(250 + SHIFT, 150)  # sides that are no multiples of 16
    first, second = (matcher.extract(image[:, begin : begin + 250]) for begin in (SHIFT, 0))
    pairs = matcher.match(first, second)

    moved = second.xy[pairs[:, 1]] - first.xy[pairs[:, 0]]
    assert len(pairs) > 50
    np.testing.assert_array_equal(np.median(moved, axis=0), (SHIFT, 0))


@pytest.mark.parametrize("features", LIGHTGLUE)
def test_an_image_without_features_has_no_matches(features, checkpoints):
    matcher = LightGlueModel(features=features, max_num_features=50).load()
    found = matcher.extract(texture())
    none = {name: found.tensors[name][:, :0] for name in ("keypoints", "descriptors")}
    empty = LearnedFeatures(xy=found.xy[:0], tensors={**found.tensors, **none})
    for pair in ((empty, found), (found, empty), (empty, empty)):
        assert matcher.match(*pair).shape == (0, 2)


@pytest.fixture
def frames(tmp_path) -> Clip:
    """Twelve frames of a moving texture."""
    folder = tmp_path / "images"
    folder.mkdir()
    image = texture(160, 96)
    for frame in range(12):
        cv2.imwrite(str(folder / f"{frame:06d}.png"), image[:, 2 * frame : 2 * frame + 128])
    camera = parse_camera("100", 128, 96).camera
    return Clip(images=folder, num_frames=12, camera=camera, scratch=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("features", LIGHTGLUE)
def test_a_method_extracts_and_matches_pairs_up_to_ten_frames_apart(
    features, checkpoints, frames, torch
):
    method, timeline = METHODS[f"{features}-lightglue"], Timeline()
    assert method.unavailable() is None
    assert described(f"{features}-lightglue") == {
        "model": {"features": features, "max_num_features": 2048},
        "device": "cuda" if torch.cuda.is_available() else "cpu",
    }
    threads = torch.get_num_threads()
    small = LearnedMethod(LightGlueModel(features=features, max_num_features=100))
    try:
        matches = small.run(frames, timeline, threads=1)
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(threads)

    assert [stage["name"] for stage in timeline.stages] == ["preprocess", "match"]
    assert len(matches.keypoints) == 12
    gaps = {second - first for first, second in matches.matches}
    assert gaps == set(range(1, 11))
    assert len(matches.matches) == 11 + 10 + 9 + 8 + 7 + 6 + 5 + 4 + 3 + 2
    assert len(matches.between(0, 1).xy0) > 0


def test_images_are_read_as_rgb(tmp_path):
    image = np.zeros((4, 6, 3), np.uint8)
    image[..., 0] = 200  # blue to OpenCV
    cv2.imwrite(str(tmp_path / "0.png"), image)
    cv2.imwrite(str(tmp_path / "1.png"), image[..., 0])
    color, grey = read_rgb(sorted(tmp_path.iterdir()))
    assert color[0, 0].tolist() == [0, 0, 200]
    assert grey[0, 0].tolist() == [200, 200, 200]
    (tmp_path / "2.png").write_text("no image")
    with pytest.raises(DataError, match=r"2\.png is not an image"):
        list(read_rgb([tmp_path / "2.png"]))


def test_what_is_no_weights_is_named_with_where_to_get_them(
    checkpoints, tmp_path, monkeypatch, torch
):
    folder = tmp_path / "hub" / "checkpoints"
    folder.mkdir(parents=True)
    for path in checkpoints.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))

    (folder / "depth-save.pth").write_text("<html>not found</html>")
    with pytest.raises(DataError, match=r"depth-save\.pth does not hold .* Save https://raw"):
        LightGlueModel(features="disk").load()
    for other in ({"other": 1}, [1, 2], {"extractor": {}}):
        torch.save(other, folder / "depth-save.pth")
        with pytest.raises(DataError, match=r"depth-save\.pth does not hold"):
            LightGlueModel(features="disk").load()
    (folder / "aliked_lightglue_v0-1_arxiv-pth").write_bytes(
        (folder / "aliked-n16.pth").read_bytes()
    )
    with pytest.raises(
        DataError, match=r"aliked_lightglue\S* does not hold .* Save https://github"
    ):
        LightGlueModel(features="aliked").load()


def test_missing_weights_are_a_row_that_says_which_and_how_to_get_them(
    torch, tmp_path, monkeypatch, make_drive
):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    data = make_drive(tmp_path / "drive", 3)
    options = ProtocolOptions(methods=("disk-lightglue", "aliked-lightglue"))
    disk, aliked = (result["error"] for result in run_protocol(options, [data], tmp_path / "out"))

    assert disk.startswith("not run: weights are missing")
    assert aliked.startswith("not run: weights are missing")
    folder = tmp_path / "torch" / "hub" / "checkpoints"
    for error, features in ((disk, "disk"), (aliked, "aliked")):
        for weights in (DETECTOR_WEIGHTS[features], MATCHER_WEIGHTS[features]):
            assert f"{weights.url} as {folder / weights.name}" in error


@pytest.mark.parametrize(
    ("module", "method", "name"),
    [
        ("kornia.feature", "disk-lightglue", "kornia"),
        ("kornia.feature", "aliked-lightglue", "kornia"),
        ("torch", "superpoint-superglue", "PyTorch"),
    ],
)
def test_a_missing_extra_is_a_row_with_the_pip_line(
    module, method, name, tmp_path, monkeypatch, make_drive
):
    monkeypatch.setitem(sys.modules, module, None)
    data = make_drive(tmp_path / "drive", 3)
    (result,) = run_protocol(ProtocolOptions(methods=(method,)), [data], tmp_path / "out")
    error = result["error"]
    assert error.startswith(f"not run: a learned matcher needs {name} (")
    assert error.endswith("): pip install 'mvmatch[deep]'")


MATCHING = """
import torch

from .superpoint import SuperPoint


class Matching(torch.nn.Module):
    def __init__(self, config):
        super().__init__()
        self.superpoint = SuperPoint(config["superpoint"])
        torch.load(FOLDER / f"superglue_{config['superglue']['weights']}.pth")
        print("loaded the stand-in for SuperGlue")

    def forward(self, data):
        assert data["image0"].shape[:2] == (1, 1)
        first, second = (torch.stack(data[f"descriptors{i}"])[0] for i in (0, 1))
        distance = torch.cdist(first.T, second.T)
        there, back = distance.argmin(dim=1), distance.argmin(dim=0)
        here = torch.arange(len(there), device=there.device)
        return {"matches0": torch.where(back[there] == here, there, -1)[None]}
"""

SUPERPOINT = """
import torch
from torch.nn import functional


class SuperPoint(torch.nn.Module):
    def __init__(self, config):
        super().__init__()
        self.config = config
        torch.load(FOLDER / "superpoint_v1.pth")
        print("loaded the stand-in for SuperPoint")

    def forward(self, data):
        image = data["image"]
        assert image.shape[1] == 1 and 0 <= image.min() and image.max() <= 1
        size = 2 * self.config["nms_radius"] + 1
        largest = functional.max_pool2d(image, size, 1, size // 2)
        peaks = ((image == largest) & (image > 0.5))[0, 0]
        peaks[:4], peaks[-4:], peaks[:, :4], peaks[:, -4:] = 0, 0, 0, 0
        y, x = torch.nonzero(peaks, as_tuple=True)
        strongest = image[0, 0, y, x].argsort(descending=True)[: self.config["max_keypoints"]]
        y, x = y[strongest], x[strongest]
        around = functional.unfold(image, 7, padding=3)[0]
        return {
            "keypoints": [torch.stack([x, y], 1).float()],
            "scores": (image[0, 0, y, x],),
            "descriptors": [around[:, y * image.shape[3] + x]],
        }
"""


@pytest.fixture
def superglue(torch, tmp_path, monkeypatch) -> Path:
    """A folder laid out as Magic Leap's, with a detector of peaks and a nearest neighbour in it."""
    folder = tmp_path / "SuperGluePretrainedNetwork"
    weights = folder / "models" / "weights"
    weights.mkdir(parents=True)
    for name in ("superpoint_v1", "superglue_indoor", "superglue_outdoor"):
        torch.save({}, weights / f"{name}.pth")
    head = "from pathlib import Path\n\nFOLDER = Path(__file__).parent / 'weights'\n"
    (folder / "models" / "matching.py").write_text(head + MATCHING)
    (folder / "models" / "superpoint.py").write_text(head + SUPERPOINT)
    monkeypatch.setenv("MVMATCH_SUPERGLUE", str(folder))
    return folder


def test_the_users_superglue_is_called_as_its_authors_call_it(superglue, capfd):
    matcher = SuperGlueModel(max_num_features=40).load()
    image = np.zeros((64, 96, 3), np.uint8)
    image[20, 40] = 255
    assert matcher.extract(image).xy.tolist() == [[40.5, 20.5]]

    image = texture(250 + SHIFT, 150)
    first, second = (matcher.extract(image[:, begin : begin + 250]) for begin in (SHIFT, 0))
    pairs = matcher.match(first, second)
    moved = second.xy[pairs[:, 1]] - first.xy[pairs[:, 0]]
    assert len(first.xy) == 40
    np.testing.assert_array_equal(np.median(moved, axis=0), (SHIFT, 0))
    assert capfd.readouterr() == ("", "")


def test_superglue_runs_in_the_protocol(superglue, tmp_path, make_drive):
    data = make_drive(tmp_path / "drive", 4)
    options = ProtocolOptions(
        methods=("superpoint-superglue",), gaps=(1,), repetitions=1, map=False
    )
    (result,) = run_protocol(options, [data], tmp_path / "out")
    assert result["error"] is None
    assert [stage["name"] for stage in result["stages"]][:3] == ["preprocess", "match", "verify"]
    assert [row["frame0"] for row in result["rows"]] == [0, 1, 2]
    assert result["settings"]["model"]["weights"] == "outdoor"
    assert result["settings"]["device"] in ("cpu", "cuda")


def test_superglue_without_a_copy_says_what_to_do(superglue, monkeypatch):
    method = METHODS["superpoint-superglue"]
    assert method.unavailable() is None
    (superglue / "models" / "weights" / "superglue_outdoor.pth").unlink()
    (superglue / "models" / "matching.py").unlink()
    reason = method.unavailable()
    assert reason is not None
    assert f"{superglue / 'models'} lacks matching.py, weights/superglue_outdoor.pth" in reason
    monkeypatch.delenv("MVMATCH_SUPERGLUE")
    reason = method.unavailable()
    assert reason is not None
    assert "its licence forbids" in reason
    assert "set MVMATCH_SUPERGLUE" in reason
