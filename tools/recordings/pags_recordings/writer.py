# SPDX-License-Identifier: Apache-2.0
"""Writes a recording: cameras first, then time steps with photographs, masks, a sweep and boxes, then the common files.

Photographs, masks and sweeps are written immediately and atomically. Poses and tables stay in memory until `finish`, which writes dataset.json last: an
interrupted folder is no data set."""

import io
import json
import os
import shutil

import numpy as np
from PIL import Image

from . import lock, poses
from .account import Account
from .errors import RecordingError

DIGITS = 6
LABELS = ("cityscapes", "cityscapes-ids", "step", "kitti-360", "waymo", "pandaset")
PICTURES = {"JPEG": ".jpg", "PNG": ".png"}
FOLDERS = (
    "images",
    "intrinsics",
    "extrinsics",
    "ego_pose",
    "lidar",
    "instances",
    "sky_masks",
    "semantic",
    "dynamic_masks",
    "ego_masks",
)
FARTHEST = 1000.0  # maximum metres from the car for LiDAR points; pags rejects more


def require(condition, message):
    if not condition:
        raise RecordingError(message)


def text_of(matrix):
    """Rows of a matrix with all digits."""
    return "".join(" ".join(repr(float(v)) for v in np.atleast_1d(row)) + "\n" for row in matrix)


def grey(mask, size, what):
    """A mask as PNG: [height, width], bool or 0..255."""
    m = np.asarray(mask)
    require(
        m.shape == (size[1], size[0]),
        f"{what}: expected {size[1]} rows of {size[0]} values, the size of the photograph, found shape {m.shape}",
    )
    require(
        m.dtype == bool or np.issubdtype(m.dtype, np.integer), f"{what}: expected booleans or integers, found {m.dtype}"
    )
    require(
        m.dtype == bool or (m.min() >= 0 and m.max() <= 255),
        f"{what}: expected values of 0 to 255, found {m.min()} to {m.max()}",
    )
    return png(m.astype(np.uint8) * (255 if m.dtype == bool else 1))


def png(array):
    out = io.BytesIO()
    Image.fromarray(array).save(out, "PNG", compress_level=3)
    return out.getvalue()


class Step:
    """One time step. Its photographs are taken by all cameras at about the same time; its boxes match them without correction."""

    def __init__(self, recording, number, time, world_from_ego):
        self.recording, self.number, self.time = recording, number, time
        self.world_from_ego = world_from_ego
        self.photographs, self.boxes = {}, {}
        self.sweep, self.swept = None, False

    def __str__(self):
        return f"time step {self.number}"

    def photograph(self, camera, picture, world_from_camera, time=None):
        """Adds the photograph of a camera, by its name: a JPEG or PNG file or its bytes, copied unchanged, or uint8 [height, width, 3]. The pose has OpenCV's
        axes: x right, y down, z forward. `time`: middle of the exposure, seconds; None: unknown."""
        r, what = self.recording, f"{self}, camera {camera!r}"
        number, size = r.camera_of(camera, self)
        require(camera not in self.photographs, f"{what} already has a photograph")
        pose = poses.check(world_from_camera, f"{what}: its pose")
        require(time is None or np.isfinite(time), f"{what}: its time is {time}")
        name = f"images/{self.number:0{DIGITS}d}_{number}"
        there = r.written(name + ".jpg", name + ".png")
        if not there:
            content, found, end = encode(picture, what)
            require(
                found == size,
                f"{what}: the photograph has {found[0]} x {found[1]} pixels, but the camera was added with {size[0]} x {size[1]}",
            )
            r.put(name + end, content)
        self.photographs[camera] = (pose, time)

    def masks(self, camera, sky=None, semantic=None, dynamic=None):
        """Adds masks of a photograph, arrays [height, width]: sky and dynamic (inside of the box of a moving object) true or 255; semantic: the class number
        of each pixel, as defined by the recording's `labels`."""
        r = self.recording
        number, size = r.camera_of(camera, self)
        name = f"{self.number:0{DIGITS}d}_{number}.png"
        for folder, mask in (("sky_masks", sky), ("semantic", semantic), ("dynamic_masks/all", dynamic)):
            if mask is not None:
                r.put(f"{folder}/{name}", grey(mask, size, f"{self}, camera {camera!r}: {folder}"))

    def has_lidar(self, columns=()):
        """Whether the sweep, with these columns, exists from an earlier run of the same import."""
        self.recording.columns = ["x", "y", "z", *columns]
        self.swept = self.recording.written(f"lidar/{self.number:0{DIGITS}d}.bin")
        return self.swept

    def lidar(self, points, world_from_points, columns=()):
        """Adds the sweep: [N, 3 or more], x y z in metres in the frame of the given pose; `columns` names the columns after x y z."""
        r = self.recording
        require(self.sweep is None, f"{self} already has a sweep")
        p = np.asarray(points, np.float64)
        columns = ["x", "y", "z", *columns]
        require(
            p.ndim == 2 and p.shape[1] == len(columns),
            f"{self}: expected LiDAR points of the columns {', '.join(columns)}, found shape {p.shape}",
        )
        require(
            r.columns in (None, columns),
            f"{self}: LiDAR columns {', '.join(columns)}, but other steps have {', '.join(r.columns or ())}",
        )
        finite = np.isfinite(p).all(1)
        r.account.leave_out("LiDAR points", "non-finite numbers", [self], int((~finite).sum()))
        p = p[finite]
        r.columns = columns
        if not len(p):
            r.account.leave_out("sweeps", "have no points", [self])
            return
        world_from_points = poses.check(world_from_points, f"{self}: the pose of its LiDAR points")
        first = next(iter(self.photographs.values()), (world_from_points, None))[0]
        car = (poses.inverse(world_from_points) @ (first if self.world_from_ego is None else self.world_from_ego))[
            :3, 3
        ]
        far = int((np.linalg.norm(p[:, :3] - car, axis=1) > FARTHEST).sum())
        require(
            not far,
            f"{self}: {far} LiDAR points are farther than {FARTHEST:g} m from the car; expected metres in the frame whose pose is given",
        )
        self.sweep, self.swept = (p, world_from_points), True

    def close(self):
        """Writes the sweep in the car's frame once the car's pose is known."""
        if self.world_from_ego is None and self.photographs:
            first = self.photographs[next(iter(self.photographs))][0]
            self.world_from_ego = first @ poses.inverse(poses.axes_from_opencv("waymo"))
        if self.sweep and self.world_from_ego is not None:
            points, pose = self.sweep
            rows = (
                points
                if np.array_equal(self.world_from_ego, pose)
                else poses.transform(poses.inverse(self.world_from_ego) @ pose, points)
            )
            self.recording.put(f"lidar/{self.number:0{DIGITS}d}.bin", rows.astype("<f4").tobytes())
            self.sweep = ()

    def box(self, track, name, world_from_box, size):
        """Adds the box of an object: id of its track (the same at every step), class name in the source, pose of its centre (x forward, y left, z up) and
        length, width, height in metres."""
        what = f"{self}, box {track!r}"
        extents = np.asarray(size, np.float64)
        require(str(track) not in self.boxes, f"{what} occurs twice; an id identifies one object")
        require(isinstance(name, str) and name.strip(), f"{what}: expected a class name, found {name!r}")
        require(
            extents.shape == (3,) and np.isfinite(extents).all() and (extents > 0).all(),
            f"{what}: expected length, width and height in metres, found {size!r}",
        )
        known = self.recording.tracks.setdefault(str(track), name)
        require(
            known == name, f"{what} is of class {name!r}, but {known!r} at another step; an id identifies one object"
        )
        self.boxes[str(track)] = (poses.check(world_from_box, f"{what}: its pose"), extents)


def encode(picture, what):
    """Bytes of a picture file that pags reads, with size and extension."""
    if isinstance(picture, (str, os.PathLike)):
        what = os.fspath(picture)
        try:
            with open(picture, "rb") as file:
                picture = file.read()
        except OSError as error:
            raise RecordingError(f"{what}: can't be read as a picture: {error.strerror}") from None
    if not isinstance(picture, bytes):
        array = np.asarray(picture)
        require(
            array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 3,
            f"{what}: expected uint8 [height, width, 3], found {array.dtype} {array.shape}",
        )
        return png(array), (array.shape[1], array.shape[0]), ".png"
    try:
        with Image.open(io.BytesIO(picture)) as opened:
            found, form, turned = opened.size, opened.format, opened.getexif().get(0x0112, 1)
            opened.load()
    except (OSError, SyntaxError) as error:
        raise RecordingError(f"{what}: can't be read as a picture: {error}") from None
    require(form in PICTURES, f"{what}: expected JPEG or PNG, found {form}; convert it first")
    require(turned == 1, f"{what}: has the EXIF orientation {turned}; rotate the pixels first to match the calibration")
    return picture, found, PICTURES[form]


LENSES = (
    "perspective",
    "fisheye",
    "rational",
    "fov",
    "thin_prism",
    "aria",
    "division",
    "eucm",
    "ftheta",
    "equirectangular",
)
LENS_TERMS = {"k": 6, "d": 3, "p": 2, "s": 4}


def growth(lens, angle):
    """The derivative of the radius by the angle for a fisheye or F-theta lens, in focal lengths."""
    powers = range(2, 7) if lens["kind"] == "ftheta" else range(3, 10, 2)
    return 1 + sum(power * factor * angle ** (power - 1) for power, factor in zip(powers, lens.get("k", [])))


def check_lens(lens, what):
    """A lens for dataset.json: kind, terms padded with zeros, field in degrees."""
    require(
        isinstance(lens, dict) and lens.get("kind") in LENSES,
        f"{what}: expected a lens as {{'kind': ...}} of {', '.join(LENSES)}, found {lens!r}",
    )
    strange = [key for key in lens if key not in ("kind", "field", *LENS_TERMS)]
    require(not strange, f"{what}: a lens has k, d, p, s and field, not {', '.join(map(repr, strange))}")
    out = {"kind": lens["kind"]}
    for key, count in LENS_TERMS.items():
        if key in lens:
            numbers = np.atleast_1d(np.asarray(lens[key], np.float64))
            require(
                numbers.ndim == 1 and len(numbers) <= count and np.isfinite(numbers).all(),
                f"{what}: expected at most {count} finite numbers for {key!r}, found {lens[key]!r}",
            )
            out[key] = numbers.tolist() + [0.0] * (count - len(numbers))
    field = float(lens.get("field", 0))
    require(0 <= field <= 360, f"{what}: expected a field of 0 to 360 degrees, found {field:g}")
    if field:
        out["field"] = field
    if lens["kind"] in ("fisheye", "ftheta"):
        angles = np.linspace(0, np.radians(min(field or 10, 355)) / 2, 2000)
        ends = np.degrees(2 * angles[growth(out, angles) <= 0])
        require(
            not len(ends),
            f"{what}: its terms are one-to-one only up to a field of {ends[0] if len(ends) else 0:.1f} degrees, not {field or 10:g}",
        )
    return out


class Recording:
    """A recording being written. Use it as a context manager: errors inside leave no data set."""

    def __init__(self, folder, labels=None, begun_from=None):
        """`labels`: meaning of the class numbers in semantic masks: "cityscapes" (train ids), "cityscapes-ids", "step", "kitti-360", "waymo", "pandaset".

        `begun_from`: a dictionary of all inputs that determine the content, stored as import.json. A folder started from the same inputs is resumed: existing
        files are not rewritten, and errors keep the folder; at the end the report is added as "result". Without it the folder must be empty, and errors empty
        it."""
        require(labels is None or labels in LABELS, f"labels are {', '.join(LABELS)}, not {labels!r}")
        self.folder, self.labels = os.fspath(folder), labels
        self.cameras, self.steps, self.tracks, self.columns = {}, [], {}, None
        self.begun_from, self.done = begun_from, False
        self.account, self.result = Account(), None
        self.lock = lock.FolderLock(self.folder)
        try:
            self.begin(lock.contents(self.folder))
        except BaseException:
            self.lock.release()
            raise

    def begin(self, there):
        if self.begun_from is not None and "import.json" in there:
            there_from = self.read_mark()
            self.result = there_from.pop("result", None)
            require(
                there_from == json.loads(json.dumps(self.begun_from)),
                f"{self.folder}: an import from another source or with other options started here (see its import.json); choose another folder, or remove it",
            )
            self.done = "dataset.json" in there
        else:
            require(not there, f"{self.folder}: not empty; choose another folder, or remove it")
            if self.begun_from is not None:
                self.put("import.json", self.mark())

    def read_mark(self):
        try:
            with open(os.path.join(self.folder, "import.json"), encoding="utf-8") as file:
                return dict(json.load(file))
        except (ValueError, TypeError):
            return {}

    def mark(self, **more):
        return (json.dumps(self.begun_from | more, indent=1) + "\n").encode()

    def written(self, *names):
        """Whether a file of one of these names exists from an earlier run of the same import."""
        return self.begun_from is not None and any(
            os.path.exists(os.path.join(self.folder, *name.split("/"))) for name in names
        )

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        try:
            if kind is None and not self.done:
                self.finish()
            elif kind is not None and self.begun_from is None:
                self.discard()
        finally:
            self.lock.release()

    def path(self, name):
        path = os.path.join(self.folder, *name.split("/"))
        os.makedirs(os.path.dirname(path), exist_ok=True)
        return path

    def put(self, name, content):
        path = self.path(name)
        with open(path + ".part", "wb") as file:
            file.write(content if isinstance(content, bytes) else content.encode())
        os.replace(path + ".part", path)

    def discard(self):
        """Removes all written files."""
        for name in FOLDERS:
            shutil.rmtree(os.path.join(self.folder, name), ignore_errors=True)
        self.lock.release()
        if os.path.isdir(self.folder) and not os.listdir(self.folder):
            os.rmdir(self.folder)

    def add_camera(self, name, size, matrix, distortion=(), pixel_centre=0.0, lens=None):
        """Adds a camera with a size in pixels (width, height), its 3x3 matrix K, and OpenCV's k1 k2 p1 p2 or k1 k2 p1 p2 k3. `pixel_centre`: coordinate in K
        of the centre of the first pixel: 0, as in OpenCV, or 0.5. `lens`: other lens models, as in docs/lenses.md: {"kind": "fisheye", "k": [k1, k2, k3, k4],
        "field": 200}."""
        require(isinstance(name, str) and name and name not in self.cameras, f"camera {name!r}: expected a unique name")
        require(not self.steps, f"camera {name!r}: add all cameras before the first time step")
        k = np.asarray(matrix, np.float64)
        require(
            k.shape == (3, 3) and np.isfinite(k).all() and k[0, 1] == k[1, 0] == 0,
            f"camera {name!r}: expected a 3x3 matrix without skew, found {k.tolist()}",
        )
        width, height = (int(v) for v in size)
        require(width > 0 and height > 0, f"camera {name!r}: expected width and height in pixels, found {size!r}")
        require(
            0.05 * width < k[0, 0] < 50 * width and 0.05 * width < k[1, 1] < 50 * width,
            f"camera {name!r}: focal lengths {k[0, 0]:g} and {k[1, 1]:g} are not plausible in pixels for a picture of {width} x {height}",
        )
        require(
            pixel_centre in (0, 0.5),
            f"camera {name!r}: expected the centre of the first pixel at 0 or 0.5, found {pixel_centre!r}",
        )
        terms = [float(v) for v in distortion]
        require(
            len(terms) in (0, 4, 5) and np.isfinite(terms).all(),
            f"camera {name!r}: expected k1 k2 p1 p2 or k1 k2 p1 p2 k3, found {len(terms)} numbers; other lenses require lens=",
        )
        require(lens is None or not terms, f"camera {name!r}: expected either a distortion or a lens, found both")
        to_corner = 0.5 - pixel_centre
        self.cameras[name] = {
            "number": len(self.cameras),
            "size": (width, height),
            "intrinsics": [k[0, 0], k[1, 1], k[0, 2] + to_corner, k[1, 2] + to_corner, *terms],
            "lens": None if lens is None else check_lens(lens, f"camera {name!r}"),
        }
        return name

    def camera_of(self, name, where):
        require(
            name in self.cameras,
            f"{where}: no camera is named {name!r}; there are {', '.join(map(repr, self.cameras)) or 'none'}",
        )
        return self.cameras[name]["number"], self.cameras[name]["size"]

    def add_step(self, time, world_from_ego=None):
        """The next time step, at a time in seconds, later than the previous one. `world_from_ego`: the car's pose (x forward, y left, z up); without it, that
        of the first camera."""
        require(np.isfinite(time), f"time step {len(self.steps)}: its time is {time}")
        if self.steps:
            last = self.steps[-1].time
            require(
                last < time,
                f"time step {len(self.steps)}: at {time:.6f} s, not later than the previous one at {last:.6f} s",
            )
            self.steps[-1].close()
            require(
                time - last < 60,
                f"time step {len(self.steps)}: {time - last:g} s after the previous one; expected seconds (pags_recordings.poses.seconds turns other units)",
            )
        step = Step(
            self,
            len(self.steps),
            float(time),
            None if world_from_ego is None else poses.check(world_from_ego, "the car's pose"),
        )
        self.steps.append(step)
        return step

    def ego_mask(self, camera, mask):
        """Sets the mask of the recording car in a camera's pictures: pixels true or 255."""
        number, size = self.camera_of(camera, "the mask of the car")
        self.put(f"ego_masks/{number}.png", grey(mask, size, f"camera {camera!r}: the mask of the car"))

    def counts(self):
        """Counts of the written items."""
        return {
            "steps": len(self.steps),
            "cameras": len(self.cameras),
            "photographs": sum(len(step.photographs) for step in self.steps),
            "sweeps": sum(step.swept for step in self.steps),
            "boxes": sum(len(step.boxes) for step in self.steps),
            "objects": len(self.tracks),
        }

    # ---- The common files ----

    def finish(self):
        """Checks the steps as a whole and writes poses, calibration, times, boxes and finally dataset.json."""
        require(
            self.cameras and self.steps, f"{self.folder}: a recording requires at least one camera and one time step"
        )
        for step in self.steps:
            lacking = [name for name in self.cameras if name not in step.photographs]
            require(
                not lacking,
                f"{step} has no photograph of {', '.join(map(repr, lacking))}; every camera requires one at every time step: omit the step or the camera",
            )
        self.result = self.account.result(self.counts())
        self.steps[-1].close()
        for camera in self.cameras.values():
            self.put(f"intrinsics/{camera['number']}.txt", text_of(np.reshape(camera["intrinsics"], (-1, 1))))
        for step in self.steps:
            self.put_step(step)
        self.put_times()
        if self.tracks:
            self.put_boxes()
        facts = {
            "kind": "pags",
            "camera_axes": "opencv",
            "extrinsics": "per-frame camera-to-world (TTT_C.txt)",
            "object_forward": "+x",
            "lidar_columns": self.columns or ["x", "y", "z"],
            "lidar_frame": "ego",
            "cameras": {str(c["number"]): name for name, c in self.cameras.items()},
        }
        lenses = {str(c["number"]): c["lens"] for c in self.cameras.values() if c["lens"]}
        if lenses:
            facts["lenses"] = lenses
        if self.labels:
            facts["labels"] = self.labels
        if self.begun_from is not None:
            self.put("import.json", self.mark(result=self.result))
        self.put("dataset.json", json.dumps(facts, indent=1) + "\n")

    def put_step(self, step):
        self.put(f"ego_pose/{step.number:0{DIGITS}d}.txt", text_of(step.world_from_ego))
        for name, (pose, _) in step.photographs.items():
            self.put(f"extrinsics/{step.number:0{DIGITS}d}_{self.cameras[name]['number']}.txt", text_of(pose))

    def put_times(self):
        exposures = {
            str(c["number"]): [step.photographs[name][1] for step in self.steps] for name, c in self.cameras.items()
        }
        times = {
            "frames": [step.time for step in self.steps],
            "cameras": {n: t for n, t in exposures.items() if any(v is not None for v in t)},
        }
        self.put("timestamps.json", json.dumps(times) + "\n")

    def put_boxes(self):
        instances, listed = {}, {str(step.number): [] for step in self.steps}
        for number, (track, name) in enumerate(self.tracks.items()):
            at = [step for step in self.steps if track in step.boxes]
            instances[str(number)] = {
                "id": track,
                "class_name": name,
                "frame_annotations": {
                    "frame_idx": [step.number for step in at],
                    "obj_to_world": [step.boxes[track][0].tolist() for step in at],
                    "box_size": [step.boxes[track][1].tolist() for step in at],
                },
            }
            for step in at:
                listed[str(step.number)].append(number)
        self.put("instances/instances_info.json", json.dumps(instances) + "\n")
        self.put("instances/frame_instances.json", json.dumps(listed) + "\n")
