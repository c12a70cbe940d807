# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks on a render node that all PAGS scenes of a .blend are present and unchanged, and that the add-on is enabled in the same version. The add-on stores
this script in every .blend with a scene, and the expected values in the custom property "pags_needs" of the Blender scenes, so the script itself needs no
add-on:

    blender -b FILE.blend --python-exit-code 1 --python-text pags_check.py -a

ends before the first frame with the reason and exit code 1 if something is missing. Without the check, a Blender without the add-on writes empty frames and
ends with 0. With *Register* ticked in the text editor, the check runs whenever Blender may run the file's scripts (-y)."""

import hashlib
import json
import os
import sys

NEEDS = "pags_needs"


def digest(path):
    """SHA-256 of a file."""
    found = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()


def named(value, folder):
    """Relative names of the files in a folder that a JSON value mentions."""
    if isinstance(value, dict):
        value = value.values()
    elif isinstance(value, str):
        return {value} if value and not os.path.isabs(value) and os.path.isfile(os.path.join(folder, value)) else set()
    elif not isinstance(value, list):
        return set()
    return set().union(*(named(v, folder) for v in value))


def identity(path):
    """[bytes, SHA-256] that identify a scene or a data set. A file: its content. A scene folder: scene.json, without the path of the data set, and the files
    it names. Other folders: names and sizes of their files and of those in `images`."""
    if os.path.isfile(path):
        return [os.path.getsize(path), digest(path)]
    inner = os.path.join(path, "scene.json")
    if os.path.isfile(inner):
        with open(inner, encoding="utf-8", errors="surrogateescape") as file:
            record = json.load(file)
        record = {key: value for key, value in record.items() if key != "dataset"}
        lines = [json.dumps(record, sort_keys=True)]
        files = [(name, os.path.join(path, name)) for name in sorted(named(record, path))]
        lines += [f"{name} {digest(file)}" for name, file in files]
    else:
        folders = [path, *filter(os.path.isdir, [os.path.join(path, "images")])]
        files = sorted(
            (os.path.relpath(f.path, path), f.path) for folder in folders for f in os.scandir(folder) if f.is_file()
        )
        lines = [f"{name.replace(os.sep, '/')} {os.path.getsize(file)}" for name, file in files]
    text = "\n".join(lines).encode("utf-8", "surrogatepass")
    return [sum(os.path.getsize(file) for _, file in files), hashlib.sha256(text).hexdigest()]


def is_same(path, record, identity_of):
    if not record.get("sha256") or os.path.isfile(path) and os.path.getsize(path) != record["size"]:
        return False
    try:
        return identity_of(path) == [record["size"], record["sha256"]]
    except (OSError, ValueError):
        return False


def absolute(value, blend):
    """A path as stored in a .blend, in absolute form."""
    return os.path.normpath(os.path.join(os.path.dirname(blend), value[2:])) if value.startswith("//") else value


def choose(value, here, blend, record, identity_of=identity):
    """Resolves the path of a scene or data set: (path, remark, problem). value: the path as stored in the root; here: its absolute form with the root in
    `blend`; record: the note that the add-on stored when the path was chosen or saved, may be empty. A file of the same name elsewhere is used, with a
    remark, if its content is the same. problem: why none is used; the path is then the missing one."""
    place = record.get("place", "")
    recorded = not record or os.path.normcase(here) == os.path.normcase(place)
    if recorded and os.path.exists(here):
        return here, "", ""
    beside = os.path.join(os.path.dirname(blend), os.path.basename(here)) if blend else here
    owned = absolute(value, record["blend"]) if record.get("blend") else here
    there = [path for path in dict.fromkeys((here, owned, place or here, beside)) if os.path.exists(path)]
    lost = f"{here}, which the .blend was saved with, is missing"
    if os.path.exists(here):
        lost = f"{here} is not the file that the .blend was saved with"
    for path in there:
        if is_same(path, record, identity_of):
            return path, "" if path == here else f"{lost}; using the same file at {path}", ""
    if place in there:
        return place, f"{lost}; using {place}, which has changed since", ""
    unlike = next((path for path in there if path != here), "")
    if unlike:
        lost += f"; {unlike} has the same name, but {'different content' if record.get('sha256') else 'no record shows whether it is the same file'}"
    missing = place if os.path.exists(here) else here
    return missing, "", f"{lost}; restore the original at {missing}, or choose the path again"


# ---- As a script of the .blend ----


def faults(bpy):
    """Why this Blender can't render the file, as a list of reasons."""
    engine = next((c for c in bpy.types.RenderEngine.__subclasses__() if getattr(c, "bl_idname", "") == "PAGS"), None)
    found, checked = [], set()
    for scene in bpy.data.scenes:
        if NEEDS not in scene or engine is not None and scene.render.engine != "PAGS":
            continue  # without the add-on Blender doesn't report the scene's engine
        needs = json.loads(scene[NEEDS])
        if engine is None:
            return [
                f"the PAGS add-on, version {needs['version']}, is not enabled in this Blender (blender --addons pags_blender, or in its preferences)"
            ]
        version = sys.modules[engine.__module__.rpartition(".")[0] + ".native"].VERSION
        if list(map(int, version.split("."))) < [int(number) for number in needs["version"].split(".")[:2]]:
            found.append(f"the PAGS add-on has version {version}; the file was saved with {needs['version']}")
        for record in needs["scenes"]:
            own, library = bpy.data.filepath, scene.library
            if library is not None:
                own = bpy.path.abspath(library.filepath, library=library.parent)
            blend = bpy.path.abspath(record["library"], start=os.path.dirname(own)) if record["library"] else own
            if (blend, record["root"]) in checked:
                continue
            checked.add((blend, record["root"]))
            value = record["path"]
            here = absolute(value, blend)
            path, _, problem = choose(value, here, blend, record if record.get("sha256") else {})
            if problem:
                found.append(f"{record['root']}: {problem}")
            elif record.get("sha256") and not is_same(path, record, identity):
                found.append(
                    f"{record['root']}: {path} is not the scene that the .blend was saved with; save it again to render this one"
                )
    return found


def main():
    import bpy

    try:
        found = faults(bpy)
    except (OSError, ValueError, KeyError, AttributeError) as error:
        found = [f"can't check: {type(error).__name__}: {error}"]
    for fault in found:
        print(f"pags_check: {fault}", file=sys.stderr, flush=True)
    if not found:
        print("pags_check: the add-on and all scenes are there", flush=True)
    elif bpy.app.background:
        os._exit(1)  # an exception would not end a render
    else:
        raise RuntimeError("; ".join(found))


if __name__ == "__main__":
    import bpy

    if any(text.use_module and text.name.startswith("pags_check") for text in bpy.data.texts):
        # run when the file was opened, perhaps not for a render
        bpy.app.handlers.render_init.append(lambda *_: main())
    else:
        main()
