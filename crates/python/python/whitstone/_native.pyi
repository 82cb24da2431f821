from os import PathLike
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

Path = Union[str, "PathLike[str]"]
Progress = Callable[[int, int], Any]

__version__: str

def main(arguments: Sequence[str]) -> int: ...
def drivers() -> str: ...
def write_image(
    path: Path,
    rgb: npt.NDArray[np.float32],
    layers: Mapping[str, npt.NDArray[np.float32]],
    attributes: Mapping[str, str],
) -> None: ...
def read_image(path: Path) -> Tuple[npt.NDArray[np.float32], Dict[str, npt.NDArray[np.float32]]]: ...
def png(rgb: npt.NDArray[np.float32], exposure: float) -> bytes: ...
def difference_png(ours: npt.NDArray[np.float32], reference: npt.NDArray[np.float32]) -> bytes: ...
def compare(
    ours: npt.NDArray[np.float32],
    reference: npt.NDArray[np.float32],
    relative: float,
    absolute: float,
    perceptual: bool,
) -> str: ...

class Scene:
    @staticmethod
    def open(
        path: Path,
        overrides: Sequence[str],
        camera: Optional[str] = None,
        max_memory: Optional[int] = None,
        max_tree_rays: Optional[int] = None,
    ) -> "Scene": ...
    @staticmethod
    def parse(
        text: str,
        base: Path,
        overrides: Sequence[str],
        max_memory: Optional[int] = None,
        max_tree_rays: Optional[int] = None,
    ) -> "Scene": ...
    def with_(self, overrides: Sequence[str]) -> "Scene": ...
    @property
    def size(self) -> Tuple[int, int]: ...
    @property
    def files(self) -> List[str]: ...
    def flattened(self) -> Tuple[str, str]: ...
    @property
    def warnings(self) -> List[str]: ...
    @property
    def accelerator(self) -> str: ...
    def render(
        self,
        threads: int = 0,
        region: Optional[Tuple[int, int, int, int]] = None,
        progress: Optional[Progress] = None,
    ) -> Tuple[npt.NDArray[np.float32], Dict[str, npt.NDArray[np.float32]], Dict[str, Any]]: ...
    def pixel(self, x: int, y: int) -> Tuple[float, float, float]: ...
    def trace(
        self, origins: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]
    ) -> Tuple[
        npt.NDArray[np.float64],
        npt.NDArray[np.int32],
        npt.NDArray[np.uint32],
        npt.NDArray[np.uint32],
        npt.NDArray[np.float64],
    ]: ...

class Oracle:
    def __init__(self, scene: Scene) -> None: ...
    def trace(
        self,
        origins: npt.NDArray[np.float64],
        directions: npt.NDArray[np.float64],
        progress: Optional[Progress] = None,
    ) -> Tuple[
        npt.NDArray[np.bool_],
        npt.NDArray[np.float64],
        npt.NDArray[np.float64],
        npt.NDArray[np.float64],
    ]: ...
    def pixel(self, x: int, y: int) -> Tuple[Tuple[float, float, float], Tuple[float, float, float]]: ...
