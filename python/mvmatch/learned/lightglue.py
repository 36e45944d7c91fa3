"""DISK or ALIKED features matched by LightGlue, all three as kornia has them.

References
----------
Tyszkiewicz et al., "DISK: learning local features with policy gradient", NeurIPS 2020.
Zhao et al., "ALIKED: a lighter keypoint and descriptor extraction network via deformable
transformation", IEEE TIM 2023.
Lindenberger et al., "LightGlue: local feature matching at light speed", ICCV 2023.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mvmatch.learned.networks import (
    MAX_NUM_FEATURES,
    LearnedFeatures,
    Weights,
    device_of_networks,
    image_tensor,
    require_kornia,
    require_torch,
    require_weights,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

_RELEASE = "https://github.com/cvg/LightGlue/releases/download/v0.1_arxiv"

DETECTOR_WEIGHTS = {
    "disk": Weights(
        "depth-save.pth",
        "https://raw.githubusercontent.com/cvlab-epfl/disk/master/depth-save.pth",
    ),
    "aliked": Weights(
        "aliked-n16.pth", "https://github.com/Shiaoming/ALIKED/raw/main/models/aliked-n16.pth"
    ),
}
"""Under the names that kornia keeps them by."""

MATCHER_WEIGHTS = {
    name: Weights(f"{name}_lightglue_v0-1_arxiv-pth", f"{_RELEASE}/{name}_lightglue.pth")
    for name in DETECTOR_WEIGHTS
}
"""Of LightGlue for each detector; kornia ends the names in ``-pth``."""


@dataclass(frozen=True, kw_only=True)
class LightGlueModel:
    """A detector of kornia with its LightGlue, in kornia's settings."""

    features: Literal["disk", "aliked"]
    max_num_features: int = MAX_NUM_FEATURES
    """Per image, the strongest."""

    def require(self) -> None:
        """Make sure that kornia and the weights are there.

        Raises
        ------
        MissingExtraError
            kornia or PyTorch is not installed.
        DataError
            Weights are missing.
        """
        require_kornia()
        require_weights(DETECTOR_WEIGHTS[self.features], MATCHER_WEIGHTS[self.features])

    def load(self) -> LightGlueMatcher:
        """Read the weights.

        Raises
        ------
        MissingExtraError
            kornia or PyTorch is not installed.
        DataError
            Weights are missing, or a file holds others.
        """
        self.require()
        return LightGlueMatcher(_detector(self), _matcher(self.features), self)


class LightGlueMatcher:
    """A detector and LightGlue in memory.

    Parameters
    ----------
    detector : kornia.feature.DISK or kornia.feature.ALIKED
    matcher : kornia.feature.LightGlue
    model : LightGlueModel
        What they are.
    """

    def __init__(self, detector: Any, matcher: Any, model: LightGlueModel) -> None:
        self._device = device_of_networks()
        self._detector = detector.to(self._device).eval()
        self._matcher = matcher.to(self._device).eval()
        # ALIKED keeps the bound itself; DISK takes sides that are multiples of 16 unless it pads.
        disk = model.features == "disk"
        self._call = {"n": model.max_num_features, "pad_if_not_divisible": True} if disk else {}

    def extract(self, image: NDArray[np.uint8]) -> LearnedFeatures:
        """Features of an image, (H, W, 3) RGB."""
        torch = require_torch()
        with torch.inference_mode():
            (found,) = self._detector(image_tensor(image), **self._call)
        return LearnedFeatures.from_network(
            found.keypoints,
            keypoints=found.keypoints[None],
            descriptors=found.descriptors[None],
            image_size=torch.tensor([image.shape[1::-1]], device=self._device),
        )

    def match(self, first: LearnedFeatures, second: LearnedFeatures) -> NDArray[np.uint32]:
        """(M, 2) numbers of features that match."""
        with require_torch().inference_mode():
            matched = self._matcher({"image0": first.tensors, "image1": second.tensors})
        return np.asarray(matched["matches"][0].cpu().numpy(), np.uint32).reshape(-1, 2)


def _detector(model: LightGlueModel) -> Any:
    kornia, weights = require_kornia(), DETECTOR_WEIGHTS[model.features]
    stored = weights.read()
    try:
        if model.features == "disk":
            network = kornia.DISK()
            network.load_state_dict(stored["extractor"])
        else:
            network = kornia.ALIKED("aliked-n16", max_num_keypoints=model.max_num_features)
            _fill(network, stored)
    except (KeyError, RuntimeError) as error:
        raise weights.unfit(error) from error
    return network


def _matcher(features: str) -> Any:
    """LightGlue of a detector; kornia's own constructor would download what it cannot read."""
    weights, lightglue = MATCHER_WEIGHTS[features], require_kornia().LightGlue
    network = lightglue(None, **{**lightglue.features[features], "weights": None})
    # The authors' files number the blocks of each kind, kornia the layers of both.
    stored = {
        re.sub(r"^(self|cross)_attn\.(\d+)", r"transformers.\2.\1_attn", name): values
        for name, values in weights.read().items()
    }
    try:
        _fill(network, stored)
    except RuntimeError as error:
        raise weights.unfit(error) from error
    return network


def _fill(network: Any, stored: dict[str, Any]) -> None:
    """Load all parameters; what files leave out beside them is derived."""
    missing = network.load_state_dict(stored, strict=False).missing_keys
    lacking = sorted({name for name, _ in network.named_parameters()} & set(missing))
    if lacking:
        raise RuntimeError(f"{lacking[0]} and {len(lacking) - 1} more are not in it")
