# SPDX-License-Identifier: GPL-3.0-or-later
"""The only importer of the C module. Keeps the scenes that are loaded, by path, and the renderers that draw them."""

import os
import threading

import bpy

VERSION = "0.1"
problem = ""
module = None
try:
    from . import pags as module  # pags.abi3.so beside this file

    if not module.version.startswith(VERSION + "."):
        problem = f"the add-on is for version {VERSION} of the PAGS module, and pags.abi3.so is {module.version}"
        module = None
except ImportError as error:
    problem = f"the PAGS module can't be loaded: {error}"


class SceneError(Exception):
    """What is to be shown to the user."""


class Entry:
    """A path's scene: being loaded, loaded, or failed."""

    def __init__(self, path):
        self.path, self.stamp = path, stamp_of(path)
        self.scene, self.error, self.views = None, "", None
        self.objects, self.info = [], {}
        self.thread = threading.Thread(target=self.load, daemon=True)
        self.thread.start()

    def load(self):
        try:
            scene = module.load(self.path)
            self.objects, self.info = scene.objects, scene.info
            self.scene = scene
        except (module.Error, MemoryError) as error:
            self.error = str(error)

    @property
    def loading(self):
        return self.thread.is_alive()


_entries = {}
_renderers = {}


def stamp_of(path):
    """Changes when the scene on disk does."""
    inner = os.path.join(path, "scene.json") if os.path.isdir(path) else path
    try:
        status = os.stat(inner)
        return status.st_mtime_ns, status.st_size
    except OSError:
        return None


def entry(path, wait):
    """The entry of an absolute path; loads where needed. wait=False: returns at once, perhaps while it is loading."""
    if not module:
        raise SceneError(problem)
    known = _entries.get(path)
    if known and not known.loading and known.error and known.stamp != stamp_of(path):
        known = None  # what was missing or broken has changed
    if not known:
        known = _entries[path] = Entry(path)
    if wait:
        known.thread.join()
    if known.error and not known.loading:
        raise SceneError(known.error)
    return known


def load(path):
    """Entry of a loaded scene; SceneError says what is wrong."""
    return entry(path, True)


def forget(path=None):
    """Reads it anew when next asked for; without a path all."""
    if path is None:
        _entries.clear()
    else:
        _entries.pop(path, None)


def renderer(kind, threads):
    """A renderer for `kind` of use with so many threads (0: all); made anew when the number changes."""
    known = _renderers.get(kind)
    if not known or known[0] != threads:
        known = _renderers[kind] = (threads, module.Renderer(threads=threads))
    return known[1]


def close():
    _renderers.clear()
    _entries.clear()


def absolute_path(root):
    """Of a root's scene. Falls back to a neighbour of the .blend of the same name, for .blends that were moved with it."""
    path = os.path.normpath(bpy.path.abspath(root.pags.path))
    if not os.path.exists(path) and bpy.data.filepath:
        beside = os.path.join(os.path.dirname(bpy.data.filepath), os.path.basename(path))
        if os.path.exists(beside):
            return beside
    return path
