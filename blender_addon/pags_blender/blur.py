# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of field and motion blur of F12: the mean of sharp pictures, each at one time of the shutter and from one point of the aperture
(Haeberli and Akeley, The Accumulation Buffer, SIGGRAPH 1990), with Blender's own settings of camera and shutter.

The samples are Hammersley's point set: the k-th of n is at the share (k + 1/2) / n of the shutter and at the radical inverses of k in bases 2 and 3
on the aperture. Pictures are summed in linear light, in the order of the samples."""

import math

import numpy as np

CURVE = 256  # number of samples of the shutter curve
NEAREST_FOCUS = 1e-3  # metres; nearer focus distances are clamped to this
FEWEST_BLADES = 3  # minimum corners of the aperture's polygon; with fewer it is a disk


def radical_inverse(k, base):
    """The radical inverse of k: its digits mirrored at the radix point, evenly spread over 0 to 1 for any run of k."""
    value, place = 0.0, 1.0 / base
    while k:
        k, digit = divmod(k, base)
        value, place = value + digit * place, place / base
    return value


# ---- The shutter ----


def position_holder(scene):
    """The settings that have motion_blur_position: those of the render or, in older Blenders, of EEVEE."""
    return scene.render if hasattr(scene.render, "motion_blur_position") else scene.eevee


def shutter(scene):
    """Opening time relative to the current frame and duration of the shutter, in frames; (0, 0) without motion blur."""
    render = scene.render
    if not render.use_motion_blur or render.motion_blur_shutter <= 0:
        return 0.0, 0.0
    length = render.motion_blur_shutter
    opens = {"START": 0.0, "CENTER": -length / 2, "END": -length}
    return opens[position_holder(scene).motion_blur_position], length


def by_curve(curve, shares):
    """Times by which the shutter has passed the given shares of the light, from its curve."""
    curve.initialize()
    middles = (np.arange(CURVE) + 0.5) / CURVE
    opening = np.array([max(0.0, curve.evaluate(curve.curves[0], float(t))) for t in middles])
    if not opening.sum() > 0:
        return shares
    return np.interp(shares, np.concatenate([[0.0], np.cumsum(opening)]) / opening.sum(), np.arange(CURVE + 1) / CURVE)


# ---- The aperture ----


def on_disk(u, v):
    """Maps a square to a disk of radius 1 (Shirley and Chiu, A Low Distortion Map Between Disk and Square, 1997)."""
    a, b = 2 * u - 1, 2 * v - 1
    if a == 0 and b == 0:
        return 0.0, 0.0
    if abs(a) > abs(b):
        radius, angle = a, math.pi / 4 * b / a
    else:
        radius, angle = b, math.pi / 2 - math.pi / 4 * a / b
    return radius * math.cos(angle), radius * math.sin(angle)


def on_polygon(u, v, blades):
    """Maps a square uniformly to a regular polygon with corners at distance 1: one triangle per side."""
    side = min(int(u * blades), blades - 1)
    out = math.sqrt(u * blades - side)
    x = y = 0.0
    for corner, weight in ((side, out * (1 - v)), (side + 1, out * v)):
        x += weight * math.cos(2 * math.pi * corner / blades)
        y += weight * math.sin(2 * math.pi * corner / blades)
    return x, y


def aperture_point(dof, u, v):
    """A point of an aperture of radius 1: right, up."""
    x, y = on_polygon(u, v, dof.aperture_blades) if dof.aperture_blades >= FEWEST_BLADES else on_disk(u, v)
    c, s = math.cos(dof.aperture_rotation), math.sin(dof.aperture_rotation)
    return (c * x - s * y) / dof.aperture_ratio, s * x + c * y


def aperture_radius(camera):
    """Aperture radius of a Blender camera (data) in metres; 0 without depth of field."""
    if not camera.dof.use_dof:
        return 0.0
    focal_length = 1e-3 * camera.lens if camera.type == "PERSP" else 1.0
    return focal_length / (2 * max(camera.dof.aperture_fstop, 1e-5))


def focus_distance(camera, depsgraph):
    """Focus distance of an evaluated camera object, metres along its axis."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return max(dof.focus_distance, NEAREST_FOCUS)
    target = dof.focus_object.evaluated_get(depsgraph)
    place = target.matrix_world
    bone = target.pose.bones.get(dof.focus_subtarget) if target.pose and dof.focus_subtarget else None
    if bone is not None:
        place = place @ bone.matrix
    axis = camera.matrix_world.col[2].to_3d().normalized()
    return max(abs(axis.dot(camera.matrix_world.translation - place.translation)), NEAREST_FOCUS)


def through(point, focus, values, pose):
    """The camera (intrinsics and pose from lens.of_camera) moved to a point of its aperture, metres right and up. Points at the focus distance keep their
    place in the picture."""
    values, pose = dict(values), pose.copy()
    behind = values.get("ortho", 0.0)  # an orthographic camera is rendered from this far behind, with parallel rays
    for axis, offset, size, centre in ((0, point[0], "fx", "cx"), (1, -point[1], "fy", "cy")):
        values[centre] += values[size] * offset / focus
        pose[:3, 3] += offset * (behind + focus) / focus * pose[:3, axis]
    return values, pose


# ---- The mean ----


class Samples:
    """The active blur effects of a picture and its number of samples; false without any."""

    def __init__(self, scene, camera, count):
        """scene, camera: evaluated."""
        opens, length = shutter(scene)
        radius = aperture_radius(camera.data)
        self.moves, self.focuses = length > 0, radius > 0
        count = count if self.moves or self.focuses else 0
        shares = (np.arange(count) + 0.5) / max(count, 1)
        if self.moves:
            shares = by_curve(scene.render.motion_blur_shutter_curve, shares)
        self.offsets = [opens + length * float(share) for share in shares] if self.moves else [0.0] * count
        self.points = [(0.0, 0.0)] * count
        if self.focuses:
            found = [
                aperture_point(camera.data.dof, radical_inverse(k, 2), radical_inverse(k, 3)) for k in range(count)
            ]
            self.points = [(radius * x, radius * y) for x, y in found]

    def __len__(self):
        return len(self.points)

    def names(self):
        return [name for name, on in (("depth of field", self.focuses), ("motion blur", self.moves)) if on]


def mean(samples, prepare, submit, take):
    """The mean colours of all samples, or None if the user has cancelled.

    prepare(offset, point) returns the arguments of a job, submit(*arguments) the job, take(job, k) the picture of sample k, or None. Consecutive equal
    arguments are rendered once. While one picture renders, the arguments of the next are prepared."""
    total = waiting = last = picture = None
    for k, (offset, point) in enumerate([*zip(samples.offsets, samples.points), (None, None)]):
        arguments = prepare(offset, point) if point is not None else None
        if k > 0:
            if waiting is not None:
                picture, waiting = take(waiting, k - 1), None
            if picture is None:
                return None
            colours = np.asarray(picture.rgba)
            total = colours.copy() if total is None else np.add(total, colours, out=total)
        if point is not None and arguments != last:
            waiting, last = submit(*arguments), arguments
    return np.multiply(total, np.float32(1 / len(samples)), out=total)
