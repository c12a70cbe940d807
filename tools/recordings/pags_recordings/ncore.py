# SPDX-License-Identifier: Apache-2.0
"""A sequence of NVIDIA's NCore format, version 4, read by its own package (nvidia-ncore; github.com/NVIDIA/ncore, docs/data/conventions.rst): component stores
of zarr, times in microseconds, a graph of poses named by frames ("rig", x forward, y left, z up; "world"; the sensors), cameras of OpenCV's axes with the
picture's corners at 0, rays and distances of LiDAR, boxes in the frame of a sensor at its time.

One time step is one photograph of the first camera, with the photograph nearest to it of each other camera and the nearest sweep. A photograph's time
and pose are those of the middle of its exposure. The package moves the points of a sweep to its end."""

import os
import pathlib

import numpy as np

from . import poses
from .errors import RecordingError
from .importing import Tracks, chosen, joined, others_reading, sweeps_of_steps

STORE = ".ncore4"  # NAME.ncore4.zarr.itar, NAME.ncore4-GROUP.zarr
LARGEST_GAP = 0.05  # maximum seconds between the photographs of a step
SWEEP_GAP = 0.06  # maximum seconds between a step and the middle of its sweep: just above half of a turn
LABEL_GAP = 0.6  # maximum seconds between two labels of a track for interpolation
FIT = 0.2  # maximum error in pixels of the polynomial that approximates an F-theta camera's own
WORLD, RIG = "world", "rig"


def reading(where):
    return others_reading(where, "nvidia-ncore can't read it")


def store_name(file):
    """The sequence name of a component store, or None."""
    name, mark, rest = file.partition(STORE)
    return name if mark and name and rest.startswith((".", "-")) and rest.endswith((".zarr", ".zarr.itar")) else None


def sequences(raw):
    """Sequences in the folder and its subfolders, by name."""
    found = {}
    for folder in [raw, *sorted(entry.path for entry in os.scandir(raw) if entry.is_dir() and STORE not in entry.name)]:
        for file in sorted(os.listdir(folder)):
            if store_name(file):
                found.setdefault(store_name(file), os.path.join(folder, store_name(file)))
    return found


def only(readers, source, what):
    """The component of that kind named default, or the only one, or None."""
    if "default" not in readers and len(readers) > 1:
        raise RecordingError(
            f"{source}: has {len(readers)} components of {what}, none named default: {', '.join(sorted(readers))}"
        )
    return "default" if "default" in readers else next(iter(readers), None)


def load(source):
    """The package's reader of a sequence."""
    import numcodecs.registry
    from ncore.data import v4

    numcodecs.registry.codec_registry.pop(
        "pickle", None
    )  # arrays of objects may be pickles, and pickles can execute code
    folder, name = os.path.split(source)
    stores = [pathlib.Path(folder, file).absolute() for file in sorted(os.listdir(folder)) if store_name(file) == name]
    with reading(source):
        groups = v4.SequenceComponentGroupsReader(stores)
        kinds = {"poses": v4.PosesComponent, "intrinsics": v4.IntrinsicsComponent, "cuboids": v4.CuboidsComponent}
        named = {what: only(groups.open_component_readers(kind.Reader), source, what) for what, kind in kinds.items()}
        for what in ("poses", "intrinsics"):
            if named[what] is None:
                raise RecordingError(
                    f"{source}: has no component of {what} among {', '.join(path.name for path in stores)}"
                )
        return v4.SequenceLoaderV4(groups, named["poses"], named["intrinsics"], None, named["cuboids"])


def ftheta(model, what):
    """Focal length, lens and principal point of an F-theta camera. The radius is a polynomial of the angle, or the angle one of the radius, which is then
    approximated by a polynomial of the angle; radius in pixels."""
    limit = float(model.max_angle)
    if model.reference_poly == type(model).PolynomialType.ANGLE_TO_PIXELDIST:
        constant, *terms = (float(v) for v in model.angle_to_pixeldist_poly)
        if abs(constant) > FIT:
            raise RecordingError(f"{what}: its polynomial is {constant:g} pixels at the angle 0; expected 0")
        terms = terms + [0.0] * (6 - len(terms))
    else:
        far = float(np.hypot(*np.asarray(model.resolution, float)))
        radii = np.linspace(0, far, 4001)
        angles = np.polynomial.polynomial.polyval(radii, np.asarray(model.pixeldist_to_angle_poly, float))
        end = int(np.argmax((angles > limit) | (np.diff(angles, append=np.inf) <= 0)))
        radii, angles = radii[: end + 1], angles[: end + 1]
        powers = angles[:, None] ** np.arange(1, 7)
        terms = (np.linalg.lstsq(powers / powers.max(0), radii, rcond=None)[0] / powers.max(0)).tolist()
        apart = np.abs(powers @ terms - radii).max()
        if apart > FIT:
            raise RecordingError(
                f"{what}: no polynomial of the sixth degree fits within {FIT} pixels; the best has an error of {apart:.2f}"
            )
        limit = min(limit, float(angles[-1]))
    focal = terms[0]
    if not focal > 0:
        raise RecordingError(f"{what}: its focal length is {focal:g} pixels")
    c, d, e = (float(v) for v in model.linear_cde)
    lens = {
        "kind": "ftheta",
        "k": [term / focal for term in terms[1:]],
        "s": [c - 1, d, e],
        "field": float(np.degrees(2 * limit)),
    }
    return [focal, focal], lens, np.asarray(model.principal_point, float) + 0.5  # this model has pixel centres at 0


def add_camera(out, name, model):
    what = f"camera {name!r}"
    if model.external_distortion_parameters is not None:
        raise RecordingError(
            f"{what} looks through a windshield with its own distortion, which is not supported; exclude it with --cameras"
        )
    kind, distortion, lens, centre = model.type(), (), None, None
    if kind == "ftheta":
        focal, lens, centre = ftheta(model, what)
    elif kind == "opencv-fisheye":
        focal, lens = (
            model.focal_length,
            {"kind": "fisheye", "k": model.radial_coeffs, "field": float(np.degrees(2 * model.max_angle))},
        )
    elif kind == "opencv-pinhole":
        focal, (k1, k2, k3, k4, k5, k6), (p1, p2) = (
            model.focal_length,
            *(v.astype(float) for v in (model.radial_coeffs, model.tangential_coeffs)),
        )
        if model.thin_prism_coeffs.any():
            raise RecordingError(
                f"{what} has thin-prism coefficients {model.thin_prism_coeffs.tolist()}, which are not supported; exclude it with --cameras"
            )
        if k4 or k5 or k6:
            lens = {"kind": "rational", "k": [k1, k2, k3], "d": [k4, k5, k6], "p": [p1, p2]}
        else:
            distortion = (k1, k2, p1, p2, k3) if any((k1, k2, k3, p1, p2)) else ()
    elif kind == "ideal-pinhole":
        focal = model.focal_length
    else:
        raise RecordingError(
            f"{what} has the unsupported model {kind!r}; expected ftheta, opencv-fisheye, opencv-pinhole or ideal-pinhole"
        )
    cx, cy = (float(v) for v in (model.principal_point if centre is None else centre))
    matrix = [[float(focal[0]), 0, cx], [0, float(focal[1]), cy], [0, 0, 1]]
    out.add_camera(name, tuple(int(v) for v in model.resolution), matrix, distortion, pixel_centre=0.5, lens=lens)


class Sequence:
    """The package's loader, with seconds since the beginning of the sequence, and poses in the world."""

    def __init__(self, source):
        self.source, self.loader = source, load(source)
        self.zero = int(self.loader.sequence_timestamp_interval_us.start)
        with reading(source):
            self.cameras = {name: self.loader.get_camera_sensor(name) for name in sorted(self.loader.camera_ids)}
            self.middles = {name: self.middle_of(camera) for name, camera in self.cameras.items()}
            self.lidars = {name: self.loader.get_lidar_sensor(name) for name in sorted(self.loader.lidar_ids)}

    @staticmethod
    def middle_of(sensor):
        """Times of the middles of a sensor's frames in microseconds."""
        begin, end = np.asarray(sensor.frames_timestamps_us, np.int64).reshape(-1, 2).T
        return begin + (end - begin) // 2

    def seconds(self, at):
        return (int(at) - self.zero) / 1e6

    def pose(self, frame, at):
        with reading(f"{self.source}: the pose of {frame!r} at {int(at)}"):
            return np.asarray(
                self.loader.pose_graph.evaluate_poses(frame, WORLD, np.array(int(at), np.uint64)), np.float64
            ).reshape(4, 4)

    def tracks(self, account):
        """Labels by id. A box refers to its frame's time, rotated about that frame's fixed axes x, y, z in this order."""
        tracks = Tracks(account)
        with reading(f"{self.source}: its boxes"):
            rows = sorted(self.loader.get_cuboid_track_observations(), key=lambda row: row.timestamp_us)
        for row in rows:
            about_x, about_y, about_z = (np.float64(v) for v in row.bbox3.rot)
            turn = (
                poses.rotation_about("z", about_z)
                @ poses.rotation_about("y", about_y)
                @ poses.rotation_about("x", about_x)
            )
            world_from_box = self.pose(row.reference_frame_id, row.reference_frame_timestamp_us) @ poses.pose(
                turn, row.bbox3.centroid
            )
            tracks.add(row.track_id, row.class_id, self.seconds(row.timestamp_us), world_from_box, row.bbox3.dim)
        return tracks

    def put_photograph(self, step, name, number):
        camera, at = self.cameras[name], self.middles[name][number]
        with reading(f"{self.source}: photograph {number} of {name}"):
            content = bytes(camera.get_frame_handle(number).get_data().get_encoded_image_data())
        step.photograph(name, content, self.pose(name, at), self.seconds(at))

    def put_sweep(self, step, name, number):
        """All returns of a sweep, motion-corrected to its end by the package."""
        lidar, parts = self.lidars[name], []
        with reading(f"{self.source}: sweep {number} of {name}"):
            rays = np.linalg.norm(lidar.get_frame_ray_bundle_direction(number), axis=1)
            if (np.abs(rays - 1) > 0.01).any():  # zarr returns zeros for missing files of a folder
                raise RecordingError(
                    f"{self.source}: sweep {number} of {name}: {int((np.abs(rays - 1) > 0.01).sum())} of {len(rays)} rays are not of length 1; a file is missing or damaged"
                )
            for back in range(lidar.get_frame_ray_bundle_return_count(number)):
                valid = lidar.get_frame_ray_bundle_return_valid_mask(number, back)
                points = lidar.get_frame_point_cloud(
                    number, motion_compensation=True, with_start_points=False, return_index=back
                ).xyz_m_end
                parts.append(
                    np.column_stack([points, lidar.get_frame_ray_bundle_return_intensity(number, back)])[valid]
                )
            end = lidar.frames_timestamps_us[number, 1]
        if parts:
            step.lidar(np.concatenate(parts), self.pose(name, end), ["intensity"])


def read(source, cameras, frames, out, progress):
    sequence = Sequence(source)
    out.account.leave_out(
        "cameras", "have no photographs", [name for name in sequence.cameras if not len(sequence.middles[name])]
    )
    names = chosen([name for name in sequence.cameras if len(sequence.middles[name])], cameras, "camera")
    if not names:
        raise RecordingError(f"{source}: has no camera with photographs")
    shots = {name: sequence.middles[name].tolist() for name in names}
    steps = [picked for _, picked in joined(shots[names[0]], shots, LARGEST_GAP, frames, out.account, 1e6)]
    if not steps:
        raise RecordingError(
            f"{source}: no time step left: none has a photograph of every camera within {LARGEST_GAP} s, or --frames selected none"
        )
    progress.total = len(steps)
    for name in names:
        with reading(f"{source}: camera {name}"):
            add_camera(out, name, sequence.cameras[name].model_parameters)
    tracks = sequence.tracks(out.account)
    lidar = max(sequence.lidars, key=lambda name: sequence.lidars[name].frames_count, default=None)
    sweeps = sequence.middle_of(sequence.lidars[lidar]) if lidar else np.empty(0)
    out.account.leave_out(
        "LiDARs", f"using the sweeps of {lidar}, which has most", [name for name in sequence.lidars if name != lidar]
    )
    middles = [int(np.mean([shots[name][number] for name, number in picked.items()])) for picked in steps]
    swept = sweeps_of_steps(
        [sequence.seconds(at) for at in sweeps],
        [sequence.seconds(at) for at in middles],
        SWEEP_GAP,
        source,
        out.account,
    )
    tracks.within(sequence.seconds(middles[0]), sequence.seconds(middles[-1]), source)
    for done, (picked, middle, sweep) in enumerate(zip(steps, middles, swept)):
        progress.show(done)
        step = out.add_step(sequence.seconds(middle), sequence.pose(RIG, middle))
        for name, number in picked.items():
            sequence.put_photograph(step, name, number)
        if sweep >= 0 and not step.has_lidar(["intensity"]):
            sequence.put_sweep(step, lidar, sweep)
        tracks.put(step, sequence.seconds(middle), LABEL_GAP)
    tracks.end()
