#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Replaces the program colmap in test_photos.py: keeps a database and writes a model as COLMAP 3.8 does, by simple
rules.

The name of a photograph sets its role: "few" has 50 features, "alone" matches no other photograph, "aside" is in a
second model; all others match each other. The arguments of each call are appended to the file $COLMAP_CALLS.
$COLMAP_DOES sets a fault: "fail" makes every step fail, "nothing" registers no photograph, "wait" lets matching
hang."""

import os
import sqlite3
import struct
import sys
import time

step, given = sys.argv[1], dict(zip(sys.argv[2::2], sys.argv[3::2]))
DOES = os.environ.get("COLMAP_DOES", "")
if "--help" in sys.argv:
    print("--SiftExtraction.use_gpu arg (=1)")
    sys.exit(0)
with open(os.environ["COLMAP_CALLS"], "a", encoding="utf-8") as calls:
    calls.write(" ".join(sys.argv[1:]) + "\n")
if DOES == "fail":
    print("there is no room for it")
    sys.exit(1)
database = sqlite3.connect(given["--database_path"])
for table in (
    "cameras (camera_id integer primary key autoincrement)",
    "images (image_id integer primary key autoincrement, name text unique, camera_id integer)",
    "keypoints (image_id integer primary key, rows integer)",
    "two_view_geometries (pair_id integer primary key, rows integer)",
):
    database.execute(f"create table if not exists {table}")


def images_file(path, names):
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(names)))
        for number, name in enumerate(names):
            file.write(
                struct.pack("<I7dI", number + 1, 1, 0, 0, 0, 0, 0, 0, 1)
                + name.encode()
                + b"\0"
                + struct.pack("<Q", 1)
                + bytes(24)
            )


def model(folder, names):
    os.makedirs(folder)
    images_file(os.path.join(folder, "images.bin"), names)
    with open(os.path.join(folder, "points3D.bin"), "wb") as file:
        file.write(struct.pack("<Q", 2))
        for error, length in ((0.5, 3), (1.5, 1)):
            file.write(struct.pack("<Q3d3BdQ", 1, 0, 0, 0, 9, 9, 9, error, length) + bytes(8 * length))
    with open(os.path.join(folder, "cameras.bin"), "wb") as file:
        file.write(struct.pack("<Q", 0))


if step == "feature_extractor":
    with open(given["--image_list_path"], encoding="utf-8") as file:
        names = file.read().splitlines()
    camera = database.execute("insert into cameras default values").lastrowid
    for name in names:
        if not os.path.exists(os.path.join(given["--image_path"], name)):
            sys.exit(f"{name}: is missing")
        number = database.execute("insert into images (name, camera_id) values (?, ?)", (name, camera)).lastrowid
        database.execute("insert into keypoints values (?, ?)", (number, 50 if "few" in name else 900))
elif step == "matches_importer":
    if DOES == "wait":
        time.sleep(600)
    numbers = dict(database.execute("select name, image_id from images"))
    with open(given["--match_list_path"], encoding="utf-8") as file:
        for line in file:
            a, b = line.split()
            fit = 0 if "alone" in line or "few" in line or ("aside" in a) != ("aside" in b) else 200
            low, high = sorted((numbers[a], numbers[b]))
            database.execute("insert into two_view_geometries values (?, ?)", (2147483647 * low + high, fit))
elif step == "mapper" and DOES != "nothing":
    names = [name for (name,) in database.execute("select name from images order by name")]
    model(os.path.join(given["--output_path"], "0"), [n for n in names if "aside" in n])
    model(
        os.path.join(given["--output_path"], "1"),
        [n for n in names if not any(word in n for word in ("aside", "alone", "few"))],
    )
elif step == "mapper":
    print("No good initial image pair found.")
database.commit()
