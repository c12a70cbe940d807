# SPDX-License-Identifier: Apache-2.0
"""Driving sets as people bring them: what lies there unread, and what can't be right, is said."""

import json
import os
import shutil
import struct
import zlib

import fixtures
from fixtures import Case, read, write


def grey_png(width, height, pixels, bits=8):
    """The bytes of a PNG of one channel; pixels: numbers, row by row."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    step = bits // 8
    raw = b"".join(int(p).to_bytes(step, "big") for p in pixels)
    rows = b"".join(b"\0" + raw[y * width * step : (y + 1) * width * step] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


class StreetCase(Case):
    """Tests that change a small street; self.street is a fresh copy."""

    @classmethod
    def setUpClass(cls):
        cls.origin = os.path.join(cls.shared_folder(), "street")
        done = fixtures.run(
            *["synth", "street", "-q", "-o", cls.origin, "--frames", "6", "--size", "96x54", "--cameras", "2", "--no-shifts"]
        )
        assert done.returncode == 0, done.stderr

    def setUp(self):
        super().setUp()
        self.street = self.path("street")
        shutil.copytree(self.origin, self.street)

    def at(self, *names):
        return os.path.join(self.street, *names)

    def names(self, folder):
        return sorted(os.listdir(self.at(folder)))

    def rename_all(self, folder, change):
        for name in self.names(folder):
            os.rename(self.at(folder, name), self.at(folder, change(name)))

    def warnings(self, *more):
        """The warnings of pags info, which leaves them in its --json, too."""
        done = self.succeeds("info", self.street, "--json", "-", *more)
        said = json.loads(done.stdout)["warnings"]
        for line in said:
            self.assertIn(f"warning: {line}", done.stderr)
        return said

    def warns(self, *words):
        """There is one warning, which holds each of the words; --strict makes it an error."""
        said = self.warnings()
        self.assertEqual(len(said), 1, said)
        for word in words:
            self.assertIn(word, said[0])
        self.fails(["info", self.street, "--strict"], *words)

    def refused(self, *words):
        return self.fails(["info", self.street], *words)


class UnreadTest(StreetCase):
    def test_a_good_set_gives_none(self):
        self.assertEqual(self.warnings(), [])
        self.assertEqual(self.warnings("--frames", "0-2", "--cameras", "1"), [])

    def test_masks_of_another_name(self):
        self.rename_all("sky_masks", lambda name: name.replace(".png", ".PNG"))
        self.warns("sky_masks: 12 of 12 files aren't read", "the first is 000_0.PNG", "names like 000_0.png")

    def test_masks_with_other_digits(self):
        self.rename_all("semantic", lambda name: "000" + name)
        self.warns("semantic: 12 of 12 files aren't read", "000000_0.png", "names like 000_0.png")

    def test_some_masks_only(self):
        os.rename(self.at("dynamic_masks/all/003_1.png"), self.at("dynamic_masks/all/003-1.png"))
        self.warns("dynamic_masks/all: 1 of 12 files", "003-1.png")

    def test_masks_beside_their_folder(self):
        shutil.copytree(self.at("dynamic_masks/all"), self.at("dynamic_masks/car"))
        shutil.copy(self.at("dynamic_masks/all/000_0.png"), self.at("dynamic_masks/000_0.png"))
        self.warns("dynamic_masks: 2 of 5 entries aren't read", "000_0.png", "all, vehicle and human")

    def test_sweeps_of_another_form(self):
        self.rename_all("lidar", lambda name: name.replace(".bin", ".npy"))
        self.warns("lidar: 6 of 6 files aren't read", "000.npy", "names like 000.bin")

    def test_sweeps_without_photographs(self):
        shutil.copy(self.at("lidar/000.bin"), self.at("lidar/017.bin"))
        self.warns("lidar: 1 of 7 files", "no photograph of their number", "017.bin")

    def test_photographs_of_another_name(self):
        os.rename(self.at("images/002_1.png"), self.at("images/front_002.png"))
        shutil.rmtree(self.at("truth"))
        lines = [line for line in self.warnings("--allow-missing") if "images:" in line]
        self.assertIn("1 of 12 files aren't read, the first is front_002.png", lines[0])

    def test_folders_of_another_name(self):
        os.rename(self.at("sky_masks"), self.at("Sky"))
        self.warns("1 folders aren't read", "Sky with 12 files, expected as sky_masks")

    def test_folders_of_no_known_name(self):
        shutil.copytree(self.at("lidar"), self.at("top_scanner"))
        self.warns("top_scanner with 6 files")

    def test_sweeps_and_times_beside_the_folders(self):
        shutil.rmtree(self.at("lidar"))
        os.rename(self.at("timestamps.json"), self.at("times_and_timestamps.json"))
        write(self.at("pointcloud.npz"), b"PK")
        self.warns("2 files aren't read", "pointcloud.npz")

    def test_labels_of_another_name(self):
        os.rename(self.at("instances/instances_info.json"), self.at("instances/info.json"))
        os.remove(self.at("instances/frame_instances.json"))
        self.warns("instances: 1 of 1 entries aren't read", "info.json", "expected instances_info.json")

    def test_what_tools_leave_is_no_data(self):
        write(self.at("semantic/segment.json"), "{}")
        write(self.at("README.md"), "a street")
        write(self.at("lidar/.DS_Store"), b"")
        shutil.copytree(self.at("images"), self.at("truth/images"))
        self.assertEqual(self.warnings(), [])

    def test_the_folders_of_street_gaussians_are_read(self):
        os.rename(self.at("sky_masks"), self.at("sky_mask"))
        os.rename(self.at("dynamic_masks/all"), self.at("dynamic_mask"))
        shutil.rmtree(self.at("dynamic_masks"))
        done = self.succeeds("info", self.street)
        self.assertIn("12 have sky_masks, 12 semantic, 12 dynamic_masks", done.stdout)
        self.assertEqual(self.warnings(), [])


if __name__ == "__main__":
    fixtures.main()
