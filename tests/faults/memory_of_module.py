# SPDX-License-Identifier: Apache-2.0
"""memory_of_module.py MODULE SCENE: limits the memory to several sizes. Short of memory, the Python module raises
MemoryError and stays usable."""

import resource
import sys

sys.path.insert(0, sys.argv[1])
import pags  # noqa: E402


def used():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()


def attempt():
    scene = pags.load(sys.argv[2])
    pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -6]
    camera = {"width": 1600, "height": 1200, "fx": 1200, "fy": 1200, "cx": 800, "cy": 600, "world_from_camera": pose}
    return bytes(memoryview(pags.render(scene, camera, threads=2).rgba).cast("B")[:4096])


before, refused = None, 0
unlimited = resource.getrlimit(resource.RLIMIT_AS)
for megabytes in [0, 1, 4, 8, 16, 24, 32, 48, 64, 96, 128, 192, 256]:
    resource.setrlimit(resource.RLIMIT_AS, (used() + megabytes * 2**20, unlimited[1]))
    try:
        attempt()
    except MemoryError as error:
        refused += 1
        print(f"{megabytes} MB: MemoryError: {error}")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, unlimited)
    picture = attempt()
    assert before is None or picture == before, "another picture"
    before = picture
sys.exit(0 if refused else 1)
