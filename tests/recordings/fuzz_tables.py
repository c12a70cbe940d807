# SPDX-License-Identifier: Apache-2.0
"""fuzz_tables.py TARGET [SECONDS [SEED]]: reads damaged tables of recordings. Reading must give right values or
raise a RecordingError that names the fault, and do nothing else. Targets: pickle (PandaSet), parquet (Waymo version
2), feather (Argoverse 2).

With atheris (pip install atheris), `FUZZ=atheris` lets libFuzzer choose inputs by code coverage. Otherwise small
tables are changed at random; equal seeds give equal inputs. An input that fails or ends the process is kept in
fuzz-TARGET-input."""

import functools
import gzip
import io
import os
import random
import resource
import signal
import struct
import sys
import tempfile
import time
import warnings

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(os.path.dirname(os.path.dirname(HERE)), "tools", "recordings")]

import numpy as np  # noqa: E402
import old_pickle  # noqa: E402
from pags_recordings import RecordingError  # noqa: E402
from pags_recordings.account import Account  # noqa: E402

MEMORY = 6 << 30  # limit of the address space of a target in bytes
SLOW = 20  # time limit of an input in seconds


# ---- Readers ----


def read_pickle(path):
    from pags_recordings import pandaset

    account = Account()
    for columns in (pandaset.SWEEP, ["class"]):
        try:
            pandaset.numbers(pandaset.table(path, columns), path, columns)
        except RecordingError:
            pass
    pandaset.read_boxes({0: path}, [0], account)


def read_parquet(path):
    """Reads every row of one component, as an import does."""
    from pags_recordings import waymo2

    folder, segment = os.path.dirname(path), os.path.basename(path)[: -len(".parquet")]
    raw, name = os.path.split(folder)
    prefix, columns, keys = PARQUET[name]
    component = waymo2.Component(raw, name, segment, prefix, columns, keys)
    for key in list(component.places)[:50]:
        component.at(*key)
    if name == "lidar_box":
        waymo2.boxes_of(raw, segment, [1], Account())
    if name == "lidar":
        lidar = waymo2.Lidar(raw, segment, Account())
        for stamp, _ in list(component.places)[:5]:
            lidar.points(stamp, np.eye(4))


def read_feather(path):
    from pags_recordings import argoverse2, poses

    stations, ways = [0.0, 1.0], [np.eye(4), np.eye(4)]
    argoverse2.read_tracks(os.path.dirname(path), 0, stations, ways, Account())
    rows = argoverse2.table(path, ["tx_m", "ty_m", "tz_m"])
    rows[["tx_m", "ty_m", "tz_m"]].to_numpy(np.float64)
    poses.interpolate(stations, ways, 0.5)


# ---- Undamaged tables ----

RETURNS = [f"range_image_return{n}.{part}" for n in (1, 2) for part in ("values", "shape")]
BOX = ["box.center.x", "box.center.y", "box.center.z", "box.heading", "box.size.x", "box.size.y", "box.size.z", "type"]
PARQUET = {
    "lidar_box": ("LiDARBoxComponent", BOX, ["key.frame_timestamp_micros", "key.laser_object_id"]),
    "lidar": ("LiDARComponent", RETURNS, ["key.frame_timestamp_micros", "key.laser_name"]),
    "vehicle_pose": ("VehiclePoseComponent", ["world_from_vehicle.transform"], ["key.frame_timestamp_micros"]),
    "camera_image": (
        "CameraImageComponent",
        ["image", "pose.transform", "pose_timestamp"],
        ["key.frame_timestamp_micros", "key.camera_name"],
    ),
}


@functools.cache
def pickles():
    from pags_recordings import pandaset

    box = dict(zip(pandaset.BOX, ["a", "Car", 0.0, 5.0, 9.0, 1.0, 2.0, 4.0, 1.5, "-", -1]))
    boxes = {name: np.array([value] * 2, object if isinstance(value, str) else None) for name, value in box.items()}
    tables = ({name: np.arange(3.0) for name in pandaset.SWEEP}, {"class": np.arange(3)}, boxes)
    return [old_pickle.dumps(old_pickle.table(columns)) for columns in tables]


def parquet_rows(name, count=6):
    prefix, columns, keys = PARQUET[name]
    for i in range(count):
        row = {
            key: f"id{i % 2}" if key.endswith("object_id") else i // 2 if key.endswith("micros") else 1 + i % 2
            for key in keys
        }
        for column in columns:
            value = (
                [1.0] * 24
                if column.endswith("values")
                else [2, 3, 4]
                if column.endswith("shape")
                else np.eye(4).ravel().tolist()
                if column.endswith("transform")
                else b"\xff\xd8"
                if column == "image"
                else 1.0
            )
            row[f"[{prefix}].{column}"] = int(value) if column == "type" else value
        yield row


@functools.cache
def parquets(name):
    import pyarrow as pa
    from pyarrow import parquet

    out = []
    for options in ({"compression": "none", "use_dictionary": False}, {"compression": "snappy", "row_group_size": 2}):
        file = io.BytesIO()
        parquet.write_table(pa.Table.from_pylist(list(parquet_rows(name))), file, **options)
        out.append(file.getvalue())
    return out


@functools.cache
def feathers():
    import pandas as pd

    numbers = dict.fromkeys(["length_m", "width_m", "height_m", "qw"], 1.0) | dict.fromkeys(
        ["qx", "qy", "qz", "tx_m", "ty_m", "tz_m"], 0.0
    )
    table = pd.DataFrame(
        [{"timestamp_ns": i * 10**8, "track_uuid": f"t{i % 2}", "category": "CAR"} | numbers for i in range(4)]
    )
    out = []
    for compression in ("uncompressed", "zstd"):
        file = io.BytesIO()
        table.to_feather(file, compression=compression)
        out.append(file.getvalue())
    return out


# ---- Changes ----

NUMBERS = [0, 1, -1, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1]


def changed(data, dice):
    """Returns the bytes with one to six random changes: flipped bits, other bytes, extreme integers, and parts
    removed, doubled or moved."""
    data = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 3, 6))):
        at, kind = dice.randrange(len(data) + 1), dice.randrange(7)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << dice.randrange(8)
        elif kind == 1:
            data[at : at + 1] = bytes([dice.randrange(256)])
        elif kind == 2:
            width = dice.choice("BHIQ")
            number = dice.choice(NUMBERS) & (256 ** struct.calcsize(width) - 1)
            data[at : at + struct.calcsize(width)] = struct.pack("<" + width, number)
        elif kind == 3:
            del data[at : at + dice.choice((1, 2, 8, 64, 1024))]
        elif kind in (4, 5):
            begin = dice.randrange(len(data) + 1)
            part = data[begin : begin + dice.choice((1, 4, 16, 200))]
            data[at : at + (len(part) if kind == 5 else 0)] = part
        else:
            del data[at:]
        if not data:
            data = bytearray(b"\0")
    return bytes(data)


class Target:
    """Writes the bytes of a table to a file in a scratch folder and calls its reader."""

    def __init__(self, name, folder):
        self.name, self.folder, self.read_count = name, folder, 0

    def begin(self, dice):
        """Returns an undamaged table and the path to write it to."""
        if self.name == "pickle":
            return dice.choice(pickles()), "00.pkl"
        if self.name == "parquet":
            part = dice.choice(sorted(PARQUET))
            return dice.choice(parquets(part)), f"{part}/a.parquet"
        return dice.choice(feathers()), "annotations.feather"

    def read(self, data, place):
        path = os.path.join(self.folder, place)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(data)
        if place == "lidar/a.parquet":
            self.calibrate()
        try:
            {"pickle": read_pickle, "parquet": read_parquet, "feather": read_feather}[self.name](path)
            self.read_count += 1
        except (RecordingError, MemoryError):
            pass

    def calibrate(self):
        import pyarrow as pa
        from pyarrow import parquet

        path = os.path.join(self.folder, "lidar_calibration", "a.parquet")
        if not os.path.exists(path):
            os.makedirs(os.path.dirname(path))
            names = ("extrinsic.transform", "beam_inclination.min", "beam_inclination.max", "beam_inclination.values")
            row = {
                f"[LiDARCalibrationComponent].{name}": value
                for name, value in zip(names, (np.eye(4).ravel().tolist(), -0.3, 0.1, [0.0]))
            }
            parquet.write_table(pa.Table.from_pylist([{"key.laser_name": laser} | row for laser in (1, 2)]), path)

    def one(self, dice):
        data, place = self.begin(dice)
        data = changed(data, dice)
        self.read(gzip.compress(data, 1) if self.name == "pickle" and dice.random() < 0.1 else data, place)


def run(name, seconds=None, seed=1, count=None, keep=None):
    """Reads damaged tables for some seconds or for a count of tables. Returns how many were tried and how many could
    be read; raises the error of an input that fails."""
    warnings.simplefilter("ignore")
    dice, begun, done = random.Random(seed), time.process_time(), 0
    with tempfile.TemporaryDirectory(prefix="pags-fuzz-") as folder, np.errstate(all="ignore"):
        target = Target(name, folder)
        while (count is None or done < count) and (seconds is None or time.process_time() - begun < seconds):
            if keep:
                data, place = target.begin(dice)
                data = changed(data, dice)
                with open(keep, "wb") as file:
                    file.write(data)
                signal.alarm(SLOW)
                target.read(data, place)
            else:
                target.one(dice)
            done += 1
        signal.alarm(0)
        return done, target.read_count


def by_atheris(name, seconds):
    import atheris

    with atheris.instrument_imports(include=["pags_recordings", "pickletools"]):
        from pags_recordings import argoverse2, frame_pickle, pandaset, waymo2  # noqa: F401
    folder, corpus = tempfile.mkdtemp(prefix="pags-fuzz-"), tempfile.mkdtemp(prefix="pags-corpus-")
    target, part = Target(name, folder), os.environ.get("FUZZ_PART", "lidar")
    for number, data in enumerate(
        pickles() if name == "pickle" else parquets(part) if name == "parquet" else feathers()
    ):
        with open(os.path.join(corpus, str(number)), "wb") as file:
            file.write(data)
    place = {"pickle": "00.pkl", "parquet": f"{part}/a.parquet", "feather": "annotations.feather"}[name]
    words = [
        sys.argv[0],
        f"-max_total_time={seconds}",
        f"-timeout={SLOW}",
        "-rss_limit_mb=4096",
        "-max_len=20000",
        "-print_final_stats=1",
        f"-artifact_prefix=fuzz-{name}-",
        corpus,
    ]
    atheris.Setup(words, lambda data: target.read(data, place))
    atheris.Fuzz()


def main():
    if len(sys.argv) < 2 or sys.argv[1] not in ("pickle", "parquet", "feather"):
        sys.exit(__doc__)
    name, seconds, seed = (
        sys.argv[1],
        float((sys.argv + ["60"])[2]) if len(sys.argv) > 2 else 60,
        int(sys.argv[3]) if len(sys.argv) > 3 else 1,
    )
    if os.environ.get("FUZZ") == "atheris":
        by_atheris(name, int(seconds))
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    keep = f"fuzz-{name}-input"
    done, read = run(name, seconds, seed, keep=keep)
    os.remove(keep)
    print(f"{name}: {done} inputs, {read} of them read, the others refused with an error that names the file")


if __name__ == "__main__":
    main()
