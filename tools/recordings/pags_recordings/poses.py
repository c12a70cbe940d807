# SPDX-License-Identifier: Apache-2.0
"""Converts other conventions to the package's own: quaternions, inverted poses, axes of cameras and boxes, units of time."""

import numpy as np

from .errors import RecordingError

RIGID = 1e-3  # maximum deviation of a matrix from a rotation; pags rejects more
UNITS = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}

# Camera axes: the rotation from OpenCV's camera axes (x right, y down, z forward) to other axes.
CAMERAS = {
    "opencv": np.eye(3),
    "opengl": np.diag([1.0, -1.0, -1.0]),  # x right, y up, z backward: Blender, NeRF's transforms.json
    "waymo": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),  # x forward, y left, z up
}
# Box axes: the rotation from our box axes (x forward, y left, z up) to axes with another front.
FRONTS = {
    "+x": np.eye(3),
    "-x": np.diag([-1.0, -1, 1]),
    "+y": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "-y": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}


def rotation_of(quaternion, order):
    """The 3x3 rotation of a quaternion in the order "wxyz" or "xyzw"; it is normalised."""
    q = np.asarray(quaternion, np.float64)
    if order not in ("wxyz", "xyzw"):
        raise RecordingError(f"the order of a quaternion is 'wxyz' or 'xyzw', not {order!r}")
    if q.shape != (4,) or not np.isfinite(q).all() or not abs(np.linalg.norm(q) - 1) < 0.01:
        raise RecordingError(f"expected a quaternion of length 1, found {q.tolist()}")
    w, x, y, z = (q if order == "wxyz" else np.roll(q, 1)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation):
    """The quaternion w x y z, with w >= 0, of a 3x3 rotation."""
    r = np.asarray(rotation, np.float64)
    # The largest of the four squares selects the root, so that none is small (Shepperd 1978).
    squares = np.array(
        [
            1 + r[0, 0] + r[1, 1] + r[2, 2],
            1 + r[0, 0] - r[1, 1] - r[2, 2],
            1 - r[0, 0] + r[1, 1] - r[2, 2],
            1 - r[0, 0] - r[1, 1] + r[2, 2],
        ]
    )
    differences = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    sums = [
        [None, *differences],
        [differences[0], None, r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
        [differences[1], r[1, 0] + r[0, 1], None, r[2, 1] + r[1, 2]],
        [differences[2], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], None],
    ]
    k = int(np.argmax(squares))
    q = np.array([squares[k] if s is None else s for s in sums[k]])
    q /= np.linalg.norm(q)
    return q if q[0] >= 0 else -q


def pose(rotation, translation, order=None):
    """A 4x4 pose from a rotation, 3x3 or a quaternion with its `order`, and a translation in metres."""
    r = np.asarray(rotation, np.float64)
    if r.shape == (4,):
        if order is None:
            raise RecordingError("state the order of the quaternion: order='wxyz' or order='xyzw'")
        r = rotation_of(r, order)
    return check(
        np.block([[r, np.reshape(np.asarray(translation, np.float64), (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    )


def rotation_about(axis, angle):
    """The 3x3 rotation about the axis "x", "y" or "z" by an angle in radians, counter-clockwise as seen from its tip."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def turned_left(angle, translation):
    """An upright pose: rotated by an angle about z, from x towards y, in radians."""
    return pose(rotation_about("z", angle), translation)


def check(matrix, what="a pose"):
    """The pose as 4x4 float64; also accepts 3x4. Raises RecordingError unless it is rigid."""
    m = np.asarray(matrix, np.float64)
    if m.shape == (3, 4):
        m = np.vstack([m, [0, 0, 0, 1]])
    if m.shape != (4, 4):
        raise RecordingError(f"{what}: expected a 4x4 matrix, found an array of shape {m.shape}")
    if not np.isfinite(m).all():
        raise RecordingError(f"{what} has non-finite numbers")
    r = m[:3, :3]
    if np.abs(r @ r.T - np.eye(3)).max() > RIGID or np.linalg.det(r) < 0 or np.abs(m[3] - [0, 0, 0, 1]).max() > RIGID:
        raise RecordingError(
            f"{what} is not rigid: its rotation times its transpose is {np.round(r @ r.T, 4).tolist()}, its determinant {np.linalg.det(r):.4f}, "
            f"its last row {m[3].tolist()}; expected a rotation and a translation"
        )
    return m


def inverse(matrix):
    """The inverse of a pose: camera_from_world becomes world_from_camera, and vice versa."""
    m = check(matrix)
    out = np.eye(4)
    out[:3, :3] = m[:3, :3].T
    out[:3, 3] = -m[:3, :3].T @ m[:3, 3]
    return out


def with_axes(table, name, what):
    if name not in table:
        raise RecordingError(f"{what} are {', '.join(table)}, not {name!r}")
    out = np.eye(4)
    out[:3, :3] = table[name]
    return out


def axes_from_opencv(axes):
    """Matrix that converts a camera pose with other axes ("opencv", "opengl", "waymo") to OpenCV's when multiplied from the right."""
    return with_axes(CAMERAS, axes, "camera axes")


def front_from_box(front):
    """Matrix that converts a box pose with its front at "+x", "-x", "+y" or "-y" to x forward, y left, z up when multiplied from the right."""
    return with_axes(FRONTS, front, "fronts of boxes")


def box_size(extents, front):
    """Length, width and height of a box from its extents along its own axes x, y, z and the direction of its front."""
    x, y, z = np.asarray(extents, np.float64)
    return np.array([y, x, z] if front in ("+y", "-y") else [x, y, z])


def transform(matrix, points):
    """The points [N, 3 or more] transformed by a pose; further columns stay unchanged."""
    out = np.array(points, np.float64)
    m = check(matrix)
    out[:, :3] = out[:, :3] @ m[:3, :3].T + m[:3, 3]
    return out


def seconds(times, unit):
    """Times in "s", "ms", "us" or "ns" as seconds since the first. Integers keep all digits."""
    t = np.asarray(times)
    if unit not in UNITS:
        raise RecordingError(f"units of time are {', '.join(UNITS)}, not {unit!r}")
    if t.size == 0 or not np.isfinite(t.astype(np.float64)).all():
        raise RecordingError("expected finite times, found none or non-finite values")
    return (t - t.flat[0]).astype(np.float64) / UNITS[unit]


def interpolate(times, matrices, at):
    """The pose at a time between those of `times`, ascending: linear translation, rotation about a fixed axis (Shoemake 1985).

    Times further outside than the adjacent interval raise RecordingError."""
    t = np.asarray(times, np.float64)
    if len(t) != len(matrices) or len(t) < 1 or (np.diff(t) <= 0).any():
        raise RecordingError(
            f"expected equal numbers of poses and ascending times; found {len(matrices)} poses and {len(t)} times"
        )
    if len(t) == 1 and at == t[0]:
        return check(matrices[0])
    i = int(np.clip(np.searchsorted(t, at) - 1, 0, max(len(t) - 2, 0)))
    if len(t) == 1 or not -1 <= (at - t[i]) / (t[i + 1] - t[i]) <= 2:
        raise RecordingError(f"no pose at {at:.6f} s: there are poses from {t[0]:.6f} to {t[-1]:.6f} s")
    share = (at - t[i]) / (t[i + 1] - t[i])
    a, b = check(matrices[i]), check(matrices[i + 1])
    qa, qb = quaternion_of(a[:3, :3]), quaternion_of(b[:3, :3])
    dot = float(qa @ qb)
    qb, dot = (qb, dot) if dot >= 0 else (-qb, -dot)
    angle = np.arccos(min(dot, 1.0))
    weights = (1 - share, share) if angle < 1e-6 else np.sin([(1 - share) * angle, share * angle]) / np.sin(angle)
    q = weights[0] * qa + weights[1] * qb
    return pose(q / np.linalg.norm(q), (1 - share) * a[:3, 3] + share * b[:3, 3], order="wxyz")
