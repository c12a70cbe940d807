# SPDX-License-Identifier: GPL-3.0-or-later
"""Locates a root's scene and data set. A path relative to its .blend changes its meaning after an append, a link, or a copy of the .blend without its scene.
So a root records for each path the absolute location, the .blend that the path is relative to, and size and hash of the content; a file of the same name
elsewhere is used only if it is the same (farm_check.py). The records are JSON: {"path": {...}, "dataset": {...}}."""

import contextlib
import functools
import json
import os
import sys

import bpy

from . import bl_info, farm_check

NAMES = ("path", "dataset")
CHECK = "pags_check.py"  # name of the text block in a .blend

_found = {}  # by input: (path, remark), valid while the path exists
_identities = {}  # by path: (stamp, identity)
_problems = {}  # by missing path: why no other was used


def stamp_of(path):
    """A stamp of the scene on disk that changes with it; None if it doesn't exist."""
    inner = os.path.join(path, "scene.json") if os.path.isdir(path) else path
    try:
        status = os.stat(inner)
        return status.st_mtime_ns, status.st_size
    except OSError:
        return None


def identity_of(path):
    """farm_check.identity, computed once per stamp."""
    stamp, known = stamp_of(path), _identities.get(path)
    if known is None or known[0] is None or known[0] != stamp:
        known = _identities[path] = (stamp, farm_check.identity(path))
    return known[1]


def look(path):
    """Computes the identity ahead in a background thread."""
    with contextlib.suppress(OSError, ValueError):
        identity_of(path)


def origin_of(root, name):
    """The linked root whose value an override inherits, or None."""
    origin = root.override_library.reference if root.override_library is not None else None
    return origin if origin is not None and getattr(root.pags, name) == getattr(origin.pags, name) else None


def library_of(root, name):
    """The library that a root's path is relative to, or None for this file."""
    origin = origin_of(root, name)
    return origin.library if origin is not None else root.library


def resolve(root, name):
    """A root's path in absolute form."""
    return os.path.normpath(bpy.path.abspath(getattr(root.pags, name), library=library_of(root, name)))


def blend_of(root, name):
    library = library_of(root, name)
    if library is None:
        return bpy.data.filepath
    return os.path.abspath(bpy.path.abspath(library.filepath, library=library.parent))


@functools.lru_cache(maxsize=64)
def parsed(text):
    try:
        return json.loads(text)
    except ValueError:
        return {}


def record_of(root, name, value=None):
    """The record of a root's path; empty if the path was changed since."""
    record = parsed(root.pags.record).get(name, {})
    return record if record.get("path") == (getattr(root.pags, name) if value is None else value) else {}


def locate(root, name="path"):
    """(path, remark, problem) of a root's scene or data set, from farm_check.choose. A result is valid while its path exists: a retrained scene stays the
    same one."""
    here, blend, record = resolve(root, name), blend_of(root, name), record_of(root, name)
    key = (getattr(root.pags, name), here, blend, json.dumps(record))
    known = _found.get(key)
    if known is not None and os.path.exists(known[0]):
        return *known, ""
    path, remark, problem = farm_check.choose(key[0], here, blend, record, identity_of)
    if problem:
        _problems[path] = problem
    else:
        _found[key] = path, remark
    return path, remark, problem


def absolute_path(root):
    """Absolute path of a root's scene; if missing, the expected one."""
    return locate(root)[0]


def problem_of(path):
    """Why no other file is used for a missing one; empty if none is missing."""
    return _problems.get(path, "") if not os.path.exists(path) else ""


def roots():
    return [o for o in bpy.data.objects if o.pags.kind == "ROOT"]


def forget():
    for kept in (_found, _identities, _problems):
        kept.clear()


def tell():
    """Warns about scenes of the opened file that are not at their stored paths."""
    for root in roots():
        _, remark, problem = locate(root)
        if remark or problem:
            print(f"PAGS: warning: {root.name}: {remark or problem}", file=sys.stderr, flush=True)


# ---- Records ----


def chosen(settings, name):
    """A path was set: its old record is invalid."""
    record = dict(parsed(settings.record))
    if record.pop(name, None) is not None:
        settings.record = json.dumps(record)


def note(root, name, value, path, blend):
    """Records the content of the absolute `path`, which `value` (relative to `blend`, or absolute) denotes. Without size and hash, nothing is recorded."""
    before, stamp = record_of(root, name, value), list(stamp_of(path) or ())
    if stamp and before.get("place") == path and before.get("stamp") == stamp:
        size, sha256 = before["size"], before["sha256"]
    else:
        try:
            size, sha256 = identity_of(path)
        except (OSError, ValueError):
            return chosen(root.pags, name)
    record = {"path": value, "place": path, "blend": blend, "stamp": stamp, "size": size, "sha256": sha256}
    text = json.dumps({**parsed(root.pags.record), name: record})
    if root.pags.record != text:
        root.pags.record = text


def place(root, name, path, blend, relative):
    """Sets a root's path to the absolute `path`, relative to `blend` or not, and records its content."""
    value = path
    if relative:
        with contextlib.suppress(ValueError):  # on another drive of Windows, where no relative path exists
            value = bpy.path.relpath(path, start=os.path.dirname(blend))
    known = dict(record_of(root, name), path=value)
    if getattr(root.pags, name) != value:
        setattr(root.pags, name, value)
        root.pags.record = json.dumps({**parsed(root.pags.record), name: known})  # the setter has removed it
    note(root, name, value, path, blend)


def owned():
    """Pairs (root, name) of the paths stored in this file."""
    mine = [(root, name) for root in roots() if root.library is None for name in NAMES if getattr(root.pags, name)]
    return [(root, name) for root, name in mine if origin_of(root, name) is None]


def targets():
    """(root, name, absolute path, whether to make it relative) of the paths stored in this file. A missing path with a record stays unchanged, with its
    record."""
    found = []
    for root, name in owned():
        path, _, problem = locate(root, name)
        relative = getattr(root.pags, name).startswith("//") or name == "path" and root.pags.relative
        if not (problem and record_of(root, name)):
            found.append((root, name, path if not problem else resolve(root, name), relative))
    return found


def leave_check():
    """Stores in the file the expected values for the check on render nodes."""
    scenes = []
    for root in roots():
        library = library_of(root, "path")
        named = {"root": root.name, "path": root.pags.path, "library": library.filepath if library is not None else ""}
        scenes.append({**record_of(root, "path"), **named})
    drawn = [scene for scene in bpy.data.scenes if scene.render.engine == "PAGS" and scenes]
    for scene in bpy.data.scenes:
        if scene.library is None and farm_check.NEEDS in scene and scene not in drawn:
            del scene[farm_check.NEEDS]
    if not drawn:
        return
    for scene in (scene for scene in drawn if scene.library is None):
        scene[farm_check.NEEDS] = json.dumps(
            {"engine": "PAGS", "version": ".".join(map(str, bl_info["version"])), "scenes": scenes}
        )
    with open(farm_check.__file__, encoding="utf-8") as file:
        script = file.read()
    text = bpy.data.texts.get(CHECK) or bpy.data.texts.new(CHECK)
    if text.library is None and text.as_string() != script:
        text.clear()
        text.write(script)
