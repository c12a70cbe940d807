# SPDX-License-Identifier: Apache-2.0
"""One step of pycolmap, started by colmap.py as a separate process that can be stopped: python pycolmap_step.py JSON."""

import json
import sys

import pycolmap


def extract(options):
    with open(options["names"], encoding="utf-8", errors="surrogateescape") as file:
        names = file.read().splitlines()
    extraction = pycolmap.FeatureExtractionOptions(max_image_size=options["side"])
    extraction.sift.max_num_features = options["features"]
    pycolmap.extract_features(
        options["database"],
        options["images"],
        image_names=names,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=pycolmap.ImageReaderOptions(camera_model="OPENCV"),
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )


def match(options):
    pycolmap.match_image_pairs(
        options["database"],
        pairing_options=pycolmap.ImportedPairingOptions(match_list_path=options["pairs"]),
        device=pycolmap.Device.cpu,
    )


def map_views(options):
    placed = 2

    def next_image():
        nonlocal placed
        placed += 1
        print(f"Registering image ({placed})", flush=True)

    pycolmap.incremental_mapping(
        options["database"], options["images"], options["models"], next_image_callback=next_image
    )


given = json.loads(sys.argv[1])
{"extract": extract, "match": match, "map": map_views}[given["step"]](given)
