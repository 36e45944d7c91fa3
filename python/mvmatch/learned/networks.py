"""What learned matchers share: their features, their weights, the libraries they need."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mvmatch.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from numpy.typing import NDArray

COLMAP_FROM_NETWORK = 0.5
"""px, added to both coordinates."""

MAX_NUM_FEATURES = 2048
"""Per image: what the authors of LightGlue and of SuperGlue take outdoors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnedFeatures:
    """Features of one image."""

    xy: NDArray[np.float32]
    """(K, 2) px, COLMAP origin."""
    tensors: dict[str, Any]
    """The same and more as the matcher takes it, on its device and with its origin."""

    @classmethod
    def from_network(cls, points: Any, /, **tensors: Any) -> LearnedFeatures:
        """Take what a network found.

        Parameters
        ----------
        points : (K, 2) tensor
            px, from the centre of the first pixel.
        tensors
            What else the matcher takes, by its names.
        """
        xy = np.asarray(points.cpu().numpy(), np.float32).reshape(-1, 2)
        return cls(xy=xy + np.float32(COLMAP_FROM_NETWORK), tensors=tensors)


class LearnedMatcher(Protocol):
    """Networks in memory that extract features and match them."""

    def extract(self, image: NDArray[np.uint8]) -> LearnedFeatures:
        """Features of an image, (H, W, 3) RGB."""
        ...

    def match(self, first: LearnedFeatures, second: LearnedFeatures) -> NDArray[np.uint32]:
        """(M, 2) numbers of features that match."""
        ...


class LearnedModel(Protocol):
    """Networks by name and settings."""

    def require(self) -> None:
        """Make sure that code and weights are there.

        Raises
        ------
        MissingExtraError
            A package is not installed.
        DataError
            Weights are missing; the message says which, and how to get them.
        """
        ...

    def load(self) -> LearnedMatcher:
        """Read the weights; raises what :meth:`require` does."""
        ...


@dataclass(frozen=True)
class Weights:
    """A file of weights in PyTorch's cache."""

    name: str
    url: str
    """Where the authors publish it."""

    @property
    def path(self) -> Path:
        """Where it lies, or would."""
        return Path(require_torch().hub.get_dir()) / "checkpoints" / self.name

    def read(self) -> dict[str, Any]:
        """Return what the file holds.

        Raises
        ------
        DataError
            It cannot be read.
        """
        try:
            stored = require_torch().load(self.path, map_location="cpu", weights_only=True)
            return dict(stored)
        except Exception as error:  # PyTorch raises half a dozen unrelated ones
            raise self.unfit(error) from error

    def unfit(self, error: Exception) -> DataError:
        """Return the error for a file that is not what its name says."""
        first_line = str(error).partition("\n")[0]
        return DataError(
            f"{self.path} does not hold the weights that belong there ({first_line}). "
            f"Save {self.url} in its place"
        )


def require_weights(*weights: Weights) -> None:
    """Make sure that files are in PyTorch's cache.

    Raises
    ------
    DataError
        Some are not.
    """
    missing = [each for each in weights if not each.path.is_file()]
    if missing:
        steps = ", and ".join(f"{each.url} as {each.path}" for each in missing)
        raise DataError(f"weights are missing, and mvmatch downloads none. Save {steps}")


def require_torch() -> Any:
    """Import PyTorch.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    return _require("torch", "PyTorch")


def require_kornia() -> Any:
    """Import ``kornia.feature``.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    return _require("kornia.feature", "kornia")


def _require(module: str, name: str) -> Any:
    try:
        return import_module(module)
    except (ImportError, OSError) as error:  # OSError: a library that PyTorch loads is broken
        message = f"a learned matcher needs {name} ({error}): pip install 'mvmatch[deep]'"
        raise MissingExtraError(message) from error


def device_of_networks() -> str:
    """Return ``cuda`` where PyTorch has it, else ``cpu``."""
    return "cuda" if require_torch().cuda.is_available() else "cpu"


def image_tensor(image: NDArray[np.uint8]) -> Any:
    """(1, C, H, W) values from 0 to 1 of an image, (H, W, 3) or (H, W), where networks run."""
    torch = require_torch()
    channels = np.ascontiguousarray(np.atleast_3d(image).transpose(2, 0, 1))
    return torch.from_numpy(channels)[None].to(device_of_networks()).float() / 255
