# SPDX-License-Identifier: Apache-2.0
"""Types of the module pags, for editors and type checkers; docs/python-api.md says what it does. Camera, Lens, View, Arrays and Picked are
names of dictionaries that only type checkers know."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, TypedDict, final, overload, type_check_only

from typing_extensions import Buffer as AnyBuffer

@type_check_only
class _Numpy(Protocol):
    @property
    def __array_interface__(self) -> dict[str, Any]: ...

# What has the buffer protocol (numpy arrays, array.array, memoryview), or nested sequences.
_Array = AnyBuffer | Sequence[Any] | _Numpy
# 12 numbers, or a matrix of 3 x 4 or 4 x 4.
_Pose = _Array
_Output = Literal[
    "rgba",
    "rgb8",
    "depth",
    "object",
    "priority",
    "heat",
    "id",
    "crypto_object",
    "crypto_class",
    "normal",
    "motion",
    "count",
    "overdraw",
]
# A camera, a camera and placements, or a camera, placements and others.
_Moment = Any
_Mode = Literal["rgb", "priority", "critical", "depth", "size", "count", "overdraw"]

__version__: str

class Error(RuntimeError):
    code: str

class Cancelled(Error): ...

@type_check_only
class Lens(TypedDict, total=False):
    kind: str
    k: Sequence[float]  # 6
    d: Sequence[float]  # 3
    p: Sequence[float]  # 2
    s: Sequence[float]  # 4
    field: float

@type_check_only
class RollingShutter(TypedDict):
    direction: str
    seconds: float
    velocity: Sequence[float]  # 6

@type_check_only
class Camera(TypedDict, total=False):
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_from_camera: tuple[float, ...]
    time: float
    lens: Lens  # absent: a pinhole
    rolling_shutter: RollingShutter  # absent: a global shutter

@type_check_only
class View(Camera, total=False):
    name: str
    test: bool
    sensor: int
    frame: int
    gain: tuple[float, float, float]
    offset: tuple[float, float, float]

@type_check_only
class Arrays(TypedDict, total=False):
    means: Buffer
    quats: Buffer
    scales: Buffer
    opacities: Buffer
    sh: Buffer
    priorities: Buffer

@type_check_only
class Other(TypedDict, total=False):
    scene: Scene
    world_from_scene: _Pose
    time: float
    placements: Sequence[tuple[int, _Pose]]
    object_values: Sequence[float]
    names: Sequence[str]

@type_check_only
class Picked(TypedDict):
    id: int
    depth: float
    priority: float
    point: tuple[float, float, float]
    object: int | None
    scene: int

@final
class Buffer:
    @property
    def shape(self) -> tuple[int, ...]: ...
    def __len__(self) -> int: ...
    def __buffer__(self, flags: int, /) -> memoryview: ...

@final
class Scene:
    def __new__(
        cls,
        means: _Array,
        quats: _Array,
        scales: _Array,
        opacities: _Array,
        sh: _Array,
        *,
        priorities: _Array | None = None,
        antialiased: bool = False,
        alpha_min: float = 0,
        background: Sequence[float] = (0, 0, 0),
        origin: Sequence[float] | None = None,
        up: str = "-y",
    ) -> Scene: ...
    @property
    def info(self) -> dict[str, Any]: ...
    @property
    def objects(self) -> list[dict[str, Any]]: ...
    @property
    def views(self) -> list[View]: ...
    @property
    def object_of(self) -> Buffer: ...
    def pose(self, object: int, time: float, /) -> tuple[float, ...] | None: ...
    def exposure(self, sensor: int, time: float, /) -> tuple[float, ...]: ...
    def track(self, object: int, /) -> Buffer: ...
    def points(self, object: int, budget: int, /) -> tuple[Buffer, Buffer]: ...
    def arrays(self, /) -> Arrays: ...
    def normals(self, /) -> Buffer: ...
    def save(self, path: str | PathLike[str], /) -> None: ...

@final
class Picture:
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def stats(self) -> dict[str, float]: ...
    @property
    def place(self) -> tuple[int, int, int, int]: ...
    @property
    def rgba(self) -> Buffer | Any: ...  # None where it wasn't asked for
    @property
    def rgb8(self) -> Buffer | Any: ...
    @property
    def crypto_object(self) -> Buffer | Any: ...
    @property
    def crypto_class(self) -> Buffer | Any: ...
    @property
    def normal(self) -> Buffer | Any: ...
    @property
    def motion(self) -> Buffer | Any: ...
    @property
    def count(self) -> Buffer | Any: ...
    @property
    def overdraw(self) -> Buffer | Any: ...
    @property
    def depth(self) -> Buffer | Any: ...
    @property
    def object(self) -> Buffer | Any: ...
    @property
    def priority(self) -> Buffer | Any: ...
    @property
    def heat(self) -> Buffer | Any: ...
    @property
    def id(self) -> Buffer | Any: ...

@final
class Job:
    def done(self, /) -> bool: ...
    def wait(self, seconds: float = -1, /) -> bool: ...
    def take(self, /) -> Picture: ...
    def cancel(self, /) -> None: ...

@final
class Deadline:
    def __new__(cls, ms: float) -> Deadline: ...
    @property
    def ms(self) -> float: ...
    @ms.setter
    def ms(self, value: float) -> None: ...
    @property
    def step(self) -> int: ...
    @property
    def haste(self) -> float: ...
    def pace(self, ms: float, wanted: float, /) -> None: ...

@final
class Renderer:
    def __new__(cls, threads: int = 0) -> Renderer: ...
    @property
    def threads(self) -> int: ...
    def submit(
        self,
        scene: Scene,
        camera: Camera | Mapping[str, Any],
        *,
        outputs: Sequence[_Output] | None = None,
        placements: Sequence[tuple[int, _Pose]] | None = None,
        others: Sequence[Other] | None = None,
        window: Sequence[int] | None = None,
        object_values: Sequence[float] | None = None,
        background: Sequence[float] | None = None,
        exposure: Sequence[float] | None = None,
        before: _Moment | None = None,
        after: _Moment | None = None,
        names: Sequence[str] | None = None,
        clips: Sequence[Sequence[float]] | None = None,
        deadline: Deadline | None = None,
        mode: _Mode = "rgb",
        early_z: str = "lossless",
        linear: bool = False,
        flip: bool = False,
        transparent: bool = False,
        antialiased: int = -1,
        sh_degree: int = 3,
        exp_degree: int = 5,
        cut: float = 0,
        near_plane: float = 0,
        depth_empty: float = 0,
        depth_scale: float = 1,
        depth_alpha: float = 0,
    ) -> Job: ...

def load(path: str | PathLike[str], edits: str | None = None, /) -> Scene: ...
def write_edited(path: str | PathLike[str], edits: str, folder: str | PathLike[str], /) -> None: ...
def cryptomatte_hash(name: str, /) -> int: ...
def available_threads() -> int: ...
def heat(value: float, /) -> tuple[float, ...]: ...
def sweep_format(folder: str | PathLike[str], /) -> tuple[int, tuple[int, int, int], str, int]: ...
def camera(
    width: int,
    height: int,
    K: _Array,
    world_from_camera: _Pose | None = None,
    *,
    camera_from_world: _Pose | None = None,
    axes: Literal["opencv", "opengl"] = "opencv",
    time: float | None = None,
) -> Camera: ...
@overload
def render(
    scene: Scene,
    camera: Camera | Mapping[str, Any],
    *,
    threads: int = 0,
    outputs: Sequence[_Output] | None = None,
    placements: Sequence[tuple[int, _Pose]] | None = None,
    others: Sequence[Other] | None = None,
    window: Sequence[int] | None = None,
    object_values: Sequence[float] | None = None,
    background: Sequence[float] | None = None,
    exposure: Sequence[float] | None = None,
    before: _Moment | None = None,
    after: _Moment | None = None,
    names: Sequence[str] | None = None,
    clips: Sequence[Sequence[float]] | None = None,
    deadline: Deadline | None = None,
    mode: _Mode = "rgb",
    early_z: str = "lossless",
    linear: bool = False,
    flip: bool = False,
    transparent: bool = False,
    antialiased: int = -1,
    sh_degree: int = 3,
    exp_degree: int = 5,
    cut: float = 0,
    near_plane: float = 0,
    depth_empty: float = 0,
    depth_scale: float = 1,
    depth_alpha: float = 0,
) -> Picture: ...
@overload
def render(
    scene: Scene,
    camera: list[Any] | tuple[Any, ...],
    *,
    threads: int = 0,
    outputs: Sequence[_Output] | None = None,
    placements: Sequence[tuple[int, _Pose]] | None = None,
    others: Sequence[Other] | None = None,
    window: Sequence[int] | None = None,
    object_values: Sequence[float] | None = None,
    background: Sequence[float] | None = None,
    exposure: Sequence[float] | None = None,
    before: _Moment | None = None,
    after: _Moment | None = None,
    names: Sequence[str] | None = None,
    clips: Sequence[Sequence[float]] | None = None,
    deadline: Deadline | None = None,
    mode: _Mode = "rgb",
    early_z: str = "lossless",
    linear: bool = False,
    flip: bool = False,
    transparent: bool = False,
    antialiased: int = -1,
    sh_degree: int = 3,
    exp_degree: int = 5,
    cut: float = 0,
    near_plane: float = 0,
    depth_empty: float = 0,
    depth_scale: float = 1,
    depth_alpha: float = 0,
) -> list[Picture]: ...
def gradients(
    scene: Scene,
    camera: Camera | Mapping[str, Any],
    rgb: _Array,
    *,
    depth: _Array | None = None,
    threads: int = 0,
    placements: Sequence[tuple[int, _Pose]] | None = None,
    background: Sequence[float] | None = None,
    transparent: bool = False,
    antialiased: int = -1,
    sh_degree: int = 3,
    near_plane: float = 0,
) -> Arrays: ...
def pick(
    scene: Scene,
    camera: Camera | Mapping[str, Any],
    x: int,
    y: int,
    *,
    placements: Sequence[tuple[int, _Pose]] | None = None,
    others: Sequence[Other] | None = None,
    clips: Sequence[Sequence[float]] | None = None,
) -> Picked | None: ...
