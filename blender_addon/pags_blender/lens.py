# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts Blender's cameras to the engine's: x right, y down, z forward; focal lengths and principal point in pixels,
image corners at 0 and width."""

import numpy as np

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # from Blender's camera axes (y up, looking along -z) to the engine's
# An orthographic view is rendered by a perspective camera this far back, in heights of the view; the perspective is then invisible.
ORTHO_DISTANCE = 400.0


def matrix(m):
    return np.array([list(row) for row in m], dtype=np.float64)


def rigid(m):
    """Splits a 4x4 matrix into (pose with its nearest rotation, mean scale)."""
    u, sizes, v = np.linalg.svd(m[:3, :3])
    out = m.copy()
    out[:3, :3] = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return out, float(np.prod(sizes) ** (1 / 3))


def pose12(m):
    return [float(v) for v in m[:3].ravel()]


class LensError(Exception):
    """Raised for a camera that the engine can't render (a panorama)."""


def intrinsics(camera, width, height, aspect_x=1.0, aspect_y=1.0):
    """fx, fy, cx, cy in pixels of a Blender camera (data) for a picture of this size."""
    if camera.type == "PANO":
        raise LensError("PAGS renders perspective and orthographic cameras; the active one is panoramic")
    wide, tall = width * aspect_x, height * aspect_y
    horizontal = camera.sensor_fit == "HORIZONTAL" or (camera.sensor_fit == "AUTO" and wide >= tall)
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    size = wide if horizontal else tall
    focal = camera.lens / sensor * size if camera.type == "PERSP" else size / camera.ortho_scale
    return {
        "width": width,
        "height": height,
        "fx": focal / aspect_x,
        "fy": focal / aspect_y * camera.pags.aspect,
        "cx": width / 2 - camera.shift_x * size / aspect_x,
        "cy": height / 2 + camera.shift_y * size / aspect_y,
    }


def of_camera(camera, world_from_camera, width, height, aspect_x=1.0, aspect_y=1.0):
    """(intrinsics, world_from_camera 4x4 in OpenCV's axes) of a Blender camera object."""
    lens = intrinsics(camera, width, height, aspect_x, aspect_y)
    pose = matrix(world_from_camera)
    if np.linalg.det(pose[:3, :3]) < 0:  # mirrored with its scene, which it sees as any camera there would
        pose[:3, 0] *= -1
    pose = rigid(pose)[0] @ FLIP
    if camera.type == "ORTHO":
        lens, pose = from_afar(lens, pose)
    return lens, pose


def of_view(window_matrix, view_matrix, width, height):
    """The same for a 3D view, from its projection matrix, which includes zoom, offset and lens."""
    p = matrix(window_matrix)
    lens = {"width": width, "height": height, "fx": p[0, 0] * width / 2, "fy": p[1, 1] * height / 2}
    pose, _ = rigid(np.linalg.inv(matrix(view_matrix)))
    pose = pose @ FLIP
    if p[3, 3] == 0:  # perspective
        lens["cx"], lens["cy"] = width / 2 * (1 - p[0, 2]), height / 2 * (1 + p[1, 2])
        return lens, pose
    lens["cx"], lens["cy"] = width / 2 * (1 + p[0, 3]), height / 2 * (1 - p[1, 3])
    return from_afar(lens, pose)


def camera_frame(camera, render, view, width, height):
    """The camera's frame in a 3D view through it: left, top, width and height in pixels of the region, from its top."""
    size = picture_size(render)
    own, _ = of_camera(camera.data, camera.matrix_world, *size, render.pixel_aspect_x, render.pixel_aspect_y)
    seen, _ = of_view(view.window_matrix, view.view_matrix, width, height)
    out = []
    for focal, centre in (("fx", "cx"), ("fy", "cy")):
        scale = seen[focal] / own[focal] * own.get("ortho", 1.0) / seen.get("ortho", 1.0)
        out.append((seen[centre] - own[centre] * scale, scale))
    return out[0][0], out[1][0], size[0] * out[0][1], size[1] * out[1][1]


def depth_planes(values, pose, near, far):
    """Near and far planes a, b, c, d in the world of a camera (intrinsics and pose, as above); visible where a x + b y + c z + d >= 0."""
    axis = pose[:3, 2]
    own = axis @ pose[:3, 3] + values.get("ortho", 0.0)
    return [(*axis, -own - near), (*-axis, own + far)]


def clip_planes(space, view, values, pose, camera):
    """The clip planes of a 3D view: of its clipping region (Alt B), and near and far of the view or its camera."""
    planes = []
    if view.use_clip_planes:  # unused planes are 0; the box of a quad view uses four
        planes = [tuple(plane) for plane in list(view.clip_planes)[: 4 if view.use_box_clip else 6] if any(plane)]
    p = view.window_matrix
    if view.view_perspective == "CAMERA" and camera is not None and camera.type == "CAMERA":
        near, far = camera.data.clip_start, camera.data.clip_end
    elif p[3][3] == 0:
        near, far = space.clip_start, space.clip_end
    else:
        near, far = (p[2][3] + 1) / p[2][2], (p[2][3] - 1) / p[2][2]
    return planes + depth_planes(values, pose, near, far)


def from_afar(lens, pose):
    """Turns an orthographic camera (fx, fy in pixels per metre) into a distant perspective camera with a long lens."""
    distance = ORTHO_DISTANCE * max(lens["height"] / lens["fy"], 10.0)
    out = dict(lens, fx=lens["fx"] * distance, fy=lens["fy"] * distance, ortho=distance)
    pose = pose.copy()
    pose[:3, 3] -= distance * pose[:3, 2]
    return out, pose


def set_blender_lens(camera, view):
    """Sets a Blender camera (data) to the lens of a view of the scene (a dictionary from the C module)."""
    width, height = view["width"], view["height"]
    camera.type = "PERSP"
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = 36.0
    camera.sensor_height = 36.0 * height / width
    camera.lens_unit = "MILLIMETERS"
    camera.lens = view["fx"] * 36.0 / width
    camera.shift_x = (width / 2 - view["cx"]) / width
    camera.shift_y = (view["cy"] - height / 2) / width
    camera.pags.aspect = view["fy"] / view["fx"]
    camera.pags.width, camera.pags.height = width, height
    camera.pags.sensor = view.get("sensor", -1)


def view_matrix4(view):
    """world_from_camera of a view as 4x4, in OpenCV's axes and the scene's world coordinates."""
    out = np.eye(4)
    out[:3] = np.array(view["world_from_camera"], dtype=np.float64).reshape(3, 4)
    return out


def picture_size(render):
    """Width and height of the render in pixels, with Blender's percentage applied."""
    share = render.resolution_percentage / 100
    return max(1, int(render.resolution_x * share)), max(1, int(render.resolution_y * share))
