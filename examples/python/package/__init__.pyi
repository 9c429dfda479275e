import os
from typing import Callable, Iterator, Mapping, Optional, Sequence, Tuple, Union, overload

import numpy as np
import numpy.typing as npt

__version__: str
EVENT_DTYPE: np.dtype
POSE_DTYPE: np.dtype

class PinholeCamera:
    def __init__(
        self,
        sensor_size: Tuple[int, int],
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        *,
        radtan: Sequence[float] = ...,
        fisheye: Sequence[float] = ...,
    ) -> None: ...
    @property
    def sensor_size(self) -> Tuple[int, int]: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...

def load_calibration(
    path: Union[str, os.PathLike[str]], camera_name: str = ..., size: Optional[Tuple[int, int]] = ...
) -> PinholeCamera: ...

class Tracker:
    def __init__(
        self,
        camera: PinholeCamera,
        dictionary: Optional[str] = ...,
        marker_length: Union[float, Mapping[int, float], None] = ...,
        *,
        boards: Union[str, os.PathLike[str], None] = ...,
        ids: Optional[Sequence[int]] = ...,
        events_per_update: Optional[int] = ...,
        filter_window_us: Optional[int] = ...,
        latency_us: Optional[float] = ...,
        latency_sigma_us: Optional[float] = ...,
    ) -> None: ...
    @overload
    def push(self, events: npt.NDArray[np.void]) -> npt.NDArray[np.void]: ...
    @overload
    def push(
        self,
        *,
        x: npt.NDArray[np.integer],
        y: npt.NDArray[np.integer],
        t: npt.NDArray[np.integer],
        p: npt.NDArray[np.integer],
    ) -> npt.NDArray[np.void]: ...
    def poses_at(self, t_us: int) -> npt.NDArray[np.void]: ...
    @property
    def statistics(self) -> dict[str, int]: ...

class Reader(Iterator[npt.NDArray[np.void]]):
    def __iter__(self) -> Reader: ...
    def __next__(self) -> npt.NDArray[np.void]: ...
    @property
    def sensor_size(self) -> Tuple[int, int]: ...
    @property
    def format(self) -> str: ...
    @property
    def statistics(self) -> dict[str, int]: ...

def read(
    path: Union[str, os.PathLike[str]],
    *,
    sensor_size: Optional[Tuple[int, int]] = ...,
    topic: str = ...,
    columns: str = ...,
    time_unit: str = ...,
) -> Reader: ...

class Trajectory:
    def __call__(self, seconds: float) -> npt.NDArray[np.float64]: ...

def handheld(
    distance: float = ...,
    *,
    amplitude_m: npt.ArrayLike = ...,
    amplitude_rad: npt.ArrayLike = ...,
    frequency_hz: float = ...,
    seed: int = ...,
) -> Trajectory: ...

class Simulator(Iterator[npt.NDArray[np.void]]):
    def __init__(
        self,
        camera: PinholeCamera,
        markers: Mapping[int, Callable[[float], npt.ArrayLike]],
        marker_length: float = ...,
        dictionary: str = ...,
        *,
        sensor: str = ...,
        seed: int = ...,
        **settings: float,
    ) -> None: ...
    def __iter__(self) -> Simulator: ...
    def __next__(self) -> npt.NDArray[np.void]: ...
    @property
    def sensor_size(self) -> Tuple[int, int]: ...
