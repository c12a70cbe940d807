# SPDX-License-Identifier: GPL-3.0-or-later
"""The only file that imports the C module. Caches loaded scenes by path, and renderers."""

import importlib.machinery
import sys
import threading
import types

import numpy as np

from . import bl_info, system, whereabouts

VERSION = ".".join(str(number) for number in bl_info["version"][:2])
problem = ""
module = None
try:
    module = importlib.import_module(system.module(), __package__)  # pags.abi3.so, on Windows pags.pyd
    if not module.__version__.startswith(VERSION + "."):
        problem = f"the add-on requires version {VERSION} of the PAGS module, but its folder has {module.__version__}"
        module = None
except ImportError as error:
    problem = f"the PAGS module can't be loaded: {error}"


def publish():
    """Makes `import pags` return the module in this Blender, unless a script has imported another. An extension passes a copy without a file: Blender warns
    about extensions whose files are top-level modules."""
    if module is None:
        return
    if not __package__.startswith("bl_ext."):
        sys.modules.setdefault("pags", module)
        return
    api = types.ModuleType("pags", module.__doc__)
    vars(api).update(
        (name, value) for name, value in vars(module).items() if not name.startswith("__") or name == "__version__"
    )
    api.__spec__ = importlib.machinery.ModuleSpec("pags", None)
    sys.modules.setdefault("pags", api)


class SceneError(Exception):
    """An error with a message for the user."""


NOTHING_LEFT = "is left by clean-up and look"  # no Gaussian left, within the engine's error text on rules


class Entry:
    """A cached scene of one path: loading, loaded or failed. edits: rules of clean-up and look (cleanup.py), or empty. If they leave no Gaussian, the scene
    is the unedited one and `bare`: only its sky is drawn."""

    def __init__(self, path, edits=""):
        self.path, self.stamp, self.edits = path, whereabouts.stamp_of(path), edits
        self.scene, self.error, self.bare = None, "", False
        self.objects, self.info, self.views = [], {}, []
        self.background = 0  # Gaussians that belong to no object
        self.exposed = False  # whether any view has an exposure
        self.thread = threading.Thread(target=self.load, daemon=True)
        self.thread.start()

    def load(self):
        try:
            scene = self.read()
            self.objects, self.info, self.views = scene.objects, scene.info, scene.views
            self.exposed = any(any(v != 1 for v in view["gain"]) or any(view["offset"]) for view in self.views)
            self.background = self.info["gaussians"] - sum(record["gaussians"] for record in self.objects)
            self.scene = scene
        except (module.Error, MemoryError) as error:
            self.error = whereabouts.problem_of(self.path) or str(error)

    def read(self):
        if self.edits:
            try:
                return module.load(self.path, self.edits)
            except module.Error as error:
                self.bare = NOTHING_LEFT in str(error)
                if not self.bare:
                    raise
        return module.load(self.path)

    def track(self, index):
        """Times (n) and poses (n, 3, 4), relative to the scene's origin, of an object's labels; a parked object has one."""
        rows = np.array(self.scene.track(index) if self.objects[index]["tracked"] else []).reshape(-1, 13)
        if not len(rows):
            rows = np.array([[self.info["time_begin"], *self.scene.pose(index, self.info["time_begin"])]])
        poses = rows[:, 1:].reshape(-1, 3, 4).copy()
        poses[:, :, 3] -= self.info["origin"]
        return rows[:, 0], poses

    def frame_of(self, root, time):
        """The frame of the timeline at a time of the scene with this root."""
        return root.pags.frame_start + (time - self.info["time_begin"]) * root.pags.fps

    def time_of(self, root, frame):
        return self.info["time_begin"] + (frame - root.pags.frame_start) / root.pags.fps

    def counts(self):
        """The size of the scene as text."""
        drawn = sum(record["gaussians"] > 0 for record in self.objects)
        told = f"{self.info['gaussians']:,} Gaussians, {drawn} object{'' if drawn == 1 else 's'}"
        return told + (f", {len(self.objects) - drawn} more without Gaussians" if drawn < len(self.objects) else "")

    @property
    def loading(self):
        return self.thread.is_alive()


cached = {}  # by path
_edited = {}  # by path and name of the root: entries with rules of clean-up and look, first the displayed one, then the one being made
_renderers = {}
generation = 0  # number of reloads, which invalidate earlier pictures


def entry(path, wait):
    """The entry of an absolute path; loads the scene if needed. wait=False: returns immediately, possibly while loading."""
    if not module:
        raise SceneError(problem)
    known = cached.get(path)
    if known and not known.loading and known.error and known.stamp != whereabouts.stamp_of(path):
        known = None  # loading failed, but the files have changed since
    if not known:
        known = cached[path] = Entry(path)
    if wait:
        known.thread.join()
    if known.error and not known.loading:
        raise SceneError(known.error)
    return known


def edited(path, owner, edits, wait):
    """The entry of a scene with rules of clean-up and look, for the root named `owner`. wait=False: returns the last ready one immediately and makes the
    newest in the background, one at a time."""
    if not edits:
        _edited.pop((path, owner), None)
        return entry(path, wait)
    plain = entry(path, wait)
    held = _edited.setdefault((path, owner), [])
    if not held or held[-1].edits != edits and (wait or not held[-1].loading):
        held.append(Entry(path, edits))
    newest = held[-1]
    if wait:
        newest.thread.join()
    if newest.loading:
        return next((known for known in reversed(held[:-1]) if known.scene is not None), plain)
    if newest.error and newest.edits == edits:
        raise SceneError(newest.error)
    del held[:-1]
    return newest if newest.scene is not None else plain


def is_making(path, owner, edits):
    """Whether the entry requested by `edited` isn't ready yet."""
    held = _edited.get((path, owner))
    return bool(edits and held and (held[-1].loading or held[-1].edits != edits))


def known(path):
    """The entry of a loaded scene, or None."""
    found = cached.get(path)
    return found if found is not None and found.scene is not None else None


def replace(path, fresh):
    """Replaces the cached scene with the reloaded one."""
    global generation
    cached[path] = fresh
    for key in [key for key in _edited if key[0] == path]:
        del _edited[key]
    generation += 1


def is_loading(path):
    """Whether a scene is loading, or would be loaded on use."""
    try:
        return entry(path, False).loading
    except SceneError:
        return False


def load(path):
    """The entry of a loaded scene; raises SceneError if it can't be loaded."""
    return entry(path, True)


def forget():
    """Drops all scenes, so that their next use reloads them."""
    cached.clear()
    _edited.clear()


def renderer(kind, threads):
    """The renderer for a use ("view", ...) with this number of threads (0: all); recreated when the number changes."""
    known = _renderers.get(kind)
    if not known or known[0] != threads:
        known = _renderers[kind] = (threads, module.Renderer(threads=threads))
    return known[1]


def close():
    _renderers.clear()
    forget()
