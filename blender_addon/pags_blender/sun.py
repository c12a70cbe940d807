# SPDX-License-Identifier: GPL-3.0-or-later
"""The sun of a recording: the direction in which the shadows that parked cars would cast agree best with the road's brightness, as the recording's cameras see
it; colour and strength by how much brighter the road is in the sun than in the shade."""

import numpy as np

from . import gather, light, native
from .sweeps import around

CELL = 0.1  # metres of the road's map
WIDE, VIEWS = 480, 120  # pixels of the width of a picture for the map, and pictures
SEEN = 25  # metres up to which a picture shows the road
NEAR, BLUR = 30, 12  # cells from a car's cells that count, and within which brightness is compared
LEAST, CLEAR = 0.1, 1.5  # correlation of a sun, and its factor over that of any direction FAR degrees from it
FAR = 45
LUMA = np.array([0.2126, 0.7152, 0.0722])


def parked(entry, height):
    """Points (n, 3) of all parked objects, relative to the scene's origin, above the road."""
    found = [np.zeros((0, 3))]
    for index, record in enumerate(entry.objects):
        if not record["tracked"] and record["gaussians"] >= 200:
            pose = entry.track(index)[1][0]
            found.append(np.array(entry.scene.points(index, 20000)[0]).reshape(-1, 3) @ pose[:, :3].T + pose[:, 3])
    points = np.vstack(found)
    return points[points[:, 2] > height + 0.2]


class Map:
    """The road from above, in cells: linear colours, and whether it is seen."""

    def __init__(self, entry, height, points, threads, tell):
        self.entry, self.height, self.points = entry, height, points
        self.low, self.high = points[:, :2].min(axis=0) - 6, points[:, :2].max(axis=0) + 6
        self.shape = tuple(((self.high - self.low) / CELL).astype(int)[::-1])
        weights, sums = np.zeros(self.shape), np.zeros((*self.shape, 3))
        views = [v for v in entry.views if "lens" not in v]
        views = views[:: len(views) // VIEWS + 1]
        for number, view in enumerate(views):
            places, colors, depths = self.seen(view, threads)
            at = self.cells(places)
            np.add.at(weights, at[:2], 1 / depths[at[2]] ** 2)
            np.add.at(sums, at[:2], colors[at[2]] / depths[at[2], None] ** 2)
            tell(number / len(views), "looking at the road")
        self.rgb = sums / np.maximum(weights, 1e-9)[..., None]
        self.taken = self.marked(points)
        self.valid = (weights > 1e-4) & (around(self.taken, 3) < 0.5)
        self.count = np.maximum(around(self.valid.astype(float), BLUR), 1)
        self.near = around(self.taken, NEAR) > 0.5
        self.bright = np.log(np.maximum(self.rgb @ LUMA, 1e-3))
        middle = np.median(self.bright[self.valid]) if self.valid.any() else 0
        self.local = np.clip(self.sharp(np.clip(self.bright, middle - 1.2, middle + 0.8)), -0.5, 0.5) * self.near

    def seen(self, view, threads):
        """Places, colours and depths of the road in a picture of the static scene."""
        share = min(1, WIDE / view["width"])
        camera = {
            **view,
            **{k: view[k] * share for k in ("fx", "fy", "cx", "cy")},
            "time": self.entry.info["time_begin"],
        }
        camera |= {k: max(1, int(view[k] * share)) for k in ("width", "height")}
        drawn = {"outputs": ("rgba", "depth"), "placements": [(-1, gather.IDENTITY)], "linear": True}
        picture = native.renderer("cube", threads).submit(self.entry.scene, camera, **drawn).take()
        depth, pose = np.asarray(picture.depth).astype(float), np.array(view["world_from_camera"]).reshape(3, 4)
        y, x = np.indices(depth.shape) + 0.5
        ray = [(x - camera["cx"]) / camera["fx"], (y - camera["cy"]) / camera["fy"], np.ones_like(x)]
        places = (np.stack(ray, axis=-1) * depth[..., None]) @ pose[:, :3].T + pose[:, 3] - self.entry.info["origin"]
        road = (depth > 0) & (depth < SEEN) & (np.abs(places[..., 2] - self.height) < 0.12 + 0.01 * depth)
        return places[road], np.asarray(picture.rgba)[..., :3][road], depth[road]

    def cells(self, places):
        """Rows, columns and numbers of the places within the map."""
        at = np.floor((places[:, 1::-1] - self.low[::-1]) / CELL).astype(int)
        inside = np.flatnonzero(((at >= 0) & (at < self.shape)).all(axis=1))
        return (*at[inside].T, inside)

    def marked(self, places):
        out = np.zeros(self.shape)
        out[self.cells(places)[:2]] = 1
        return out

    def sharp(self, values):
        """The difference of each cell to the mean around it."""
        return (values - around(values * self.valid, BLUR) / self.count) * self.valid

    def agreement(self, angles):
        """Correlation of the shadows that the sun casts from a direction (azimuth, elevation; degrees) with the road."""
        towards = direction(angles)
        shadows = self.marked(self.points - towards * ((self.points[:, 2:] - self.height) / towards[2]))
        shadows = self.sharp((around(shadows, 2) > 0.5).astype(float)) * self.near
        size = np.sqrt((shadows**2).sum() * (self.local**2).sum())
        return -(shadows * self.local).sum() / size if size > 0 else 0.0


def direction(angles):
    """The unit vector towards the sun."""
    azimuth, up = np.radians(angles)
    return np.array([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])


def brightness(road, towards, ambient):
    """Linear colour of a white surface that faces the sun, from the road in the sun and in the shade of all things, which Otsu's threshold (1979) divides.
    The road is grey, so that its colour in the shade is that of the light there."""
    values = road.bright[road.valid]
    counts, edges = np.histogram(values, 200, np.percentile(values, (1, 97)))
    weight, mass = np.cumsum(counts), np.cumsum(counts * (edges[1:] + edges[:-1]) / 2)
    spread = (mass[-1] * weight / weight[-1] - mass) ** 2 / np.maximum(weight * (weight[-1] - weight), 1)
    sunny = road.bright > edges[1 + np.argmax(spread)]
    lit, shade = (np.median(road.rgb[road.valid & part], axis=0) for part in (sunny, ~sunny))
    return (lit - shade) * (ambient @ LUMA) / (shade @ LUMA) / towards[2]


def estimate(entry, threads, tell=lambda share, what: None):
    """Unit vector towards the sun in the scene's axes, and the linear colour of a white surface that faces it. SceneError says that no sun is visible."""
    height = light.road_height(entry)
    points = parked(entry, height)
    if not len(points) or entry.info["up"] != "z":
        raise native.SceneError("no sun visible: there are no parked cars whose shadows would show it")
    road = Map(entry, height, points, threads, tell)
    tried = [(azimuth, up) for up in range(20, 80, 10) for azimuth in range(0, 360, 15)]
    found = {}
    for number, angles in enumerate(tried):
        found[angles] = road.agreement(angles)
        tell(number / len(tried), "looking for the sun")
    best = max(found, key=found.get)
    others = [value for a, value in found.items() if direction(a) @ direction(best) < np.cos(np.radians(FAR))]
    if found[best] < max(LEAST, CLEAR * max(others)):
        raise native.SceneError("no sun visible: the road shows no clear shadows of parked cars")
    for step in (5, 2, 1):
        while True:
            around_best = [
                (best[0] + a * step, best[1] + u * step) for a, u in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
            ]
            for angles in around_best:
                found.setdefault(angles, road.agreement(angles) if 5 < angles[1] < 88 else -1)
            if max(around_best, key=found.get) == best:
                break
            best = max(around_best, key=found.get)
    eye = np.append(np.median(light.eyes_of(entry)[:, :2], axis=0), height + 0.3)
    sky = light.panorama(entry, eye, np.eye(3), threads, 128)
    up = np.sin(np.pi * ((np.arange(64) + 0.5) / 64 - 0.5))[:, None]
    facing = np.maximum(up, 0) * np.sqrt(1 - up**2) * np.ones((1, 128))
    ambient = (sky * facing[..., None]).sum(axis=(0, 1)) / facing.sum()
    return direction(best), brightness(road, direction(best), ambient)
