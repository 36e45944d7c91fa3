"""SuperPoint and SuperGlue from the user's own copy of Magic Leap's repository.

Its licence (academic, non-commercial) forbids to hand it on: nothing of it is here.

References
----------
DeTone et al., "SuperPoint: self-supervised interest point detection and description", CVPRW 2018.
Sarlin et al., "SuperGlue: learning feature matching with graph neural networks", CVPR 2020.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mvmatch.errors import DataError
from mvmatch.learned.images import grey_of
from mvmatch.learned.networks import (
    MAX_NUM_FEATURES,
    LearnedFeatures,
    device_of_networks,
    image_tensor,
    require_torch,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

FOLDER = "MVMATCH_SUPERGLUE"
"""Environment variable that names the folder of the copy."""

_REPOSITORY = "https://github.com/magicleap/SuperGluePretrainedNetwork"
_PACKAGE = "mvmatch_users_superglue"
"""What its package ``models`` is called here; others may have one of that name."""


@dataclass(frozen=True, kw_only=True)
class SuperGlueModel:
    """SuperPoint and SuperGlue, in the settings that their authors recommend outdoors."""

    weights: Literal["indoor", "outdoor"] = "outdoor"
    max_num_features: int = MAX_NUM_FEATURES
    """Per image, the strongest."""
    nms_radius: int = 3
    """px around a keypoint without another."""

    def require(self) -> None:
        """Make sure that PyTorch and the user's copy are there.

        Raises
        ------
        MissingExtraError
            PyTorch is not installed.
        DataError
            The copy is not named, or lacks files.
        """
        require_torch()
        self._folder()

    def load(self) -> SuperGlueMatcher:
        """Read the code and the weights; raises what :meth:`require` does."""
        self.require()
        package = ModuleType(_PACKAGE)
        package.__path__ = [str(self._folder() / "models")]
        sys.modules[_PACKAGE] = package
        superpoint = {"nms_radius": self.nms_radius, "max_keypoints": self.max_num_features}
        superglue = {"weights": self.weights}
        with contextlib.redirect_stdout(io.StringIO()):  # it prints that it read its weights
            matching = import_module(f"{_PACKAGE}.matching").Matching(
                {"superpoint": superpoint, "superglue": superglue}
            )
        return SuperGlueMatcher(matching)

    def _folder(self) -> Path:
        """Where the copy is, made sure that it holds what is read."""
        named = os.environ.get(FOLDER)
        if not named:
            raise DataError(
                f"its licence forbids mvmatch to bring it: clone {_REPOSITORY}, "
                f"if its terms suit you, and set {FOLDER} to that folder"
            )
        folder = Path(named).expanduser()
        names = (
            "matching.py",
            "weights/superpoint_v1.pth",
            f"weights/superglue_{self.weights}.pth",
        )
        missing = [name for name in names if not (folder / "models" / name).is_file()]
        if missing:
            raise DataError(
                f"{folder / 'models'} lacks {', '.join(missing)}: set {FOLDER} to "
                f"a clone of {_REPOSITORY}"
            )
        return folder


class SuperGlueMatcher:
    """SuperPoint and SuperGlue in memory.

    Parameters
    ----------
    matching
        The ``Matching`` of the user's copy: module ``superpoint``, and a call with the
        features of both images that matches them.
    """

    def __init__(self, matching: Any) -> None:
        self._matching = matching.to(device_of_networks()).eval()

    def extract(self, image: NDArray[np.uint8]) -> LearnedFeatures:
        """Features of an image, (H, W, 3) RGB."""
        grey = image_tensor(grey_of(image))
        with require_torch().inference_mode():
            found = self._matching.superpoint({"image": grey})
        # Of the image, matching asks for the shape.
        shape = grey.new_zeros(1).expand(grey.shape)
        return LearnedFeatures.from_network(found["keypoints"][0], image=shape, **found)

    def match(self, first: LearnedFeatures, second: LearnedFeatures) -> NDArray[np.uint32]:
        """(M, 2) numbers of features that match."""
        data = {
            f"{name}{number}": value
            for number, features in enumerate((first, second))
            for name, value in features.tensors.items()
        }
        with require_torch().inference_mode():
            matched = self._matching(data)["matches0"].cpu().numpy().reshape(-1)
        (there,) = np.nonzero(matched >= 0)
        return np.column_stack([there, matched[there]]).astype(np.uint32)
