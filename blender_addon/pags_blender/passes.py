# SPDX-License-Identifier: GPL-3.0-or-later
"""F12's passes for compositing: expected normals, motion vectors (Blender's Vector pass) and Cryptomattes of objects and classes.

The view layer's own settings enable them, so that Blender's compositor and files support them. The names in a Cryptomatte are those of Blender's objects, as
its Cryptomatte node lists them; the classes use Blender's pass for assets, which are groups of objects, too."""

import json

import numpy as np

from . import gather, lens, native

MATTES = {"CryptoObject": "crypto_object", "CryptoAsset": "crypto_class"}
MOST_PASSES = 3  # passes per matte, each with two names per pixel: the engine finds the six largest


def mattes(view_layer):
    """Names of the matte passes enabled in the view layer, by layer."""
    count = min(MOST_PASSES, (view_layer.pass_cryptomatte_depth + 1) // 2)
    asked = {
        "CryptoObject": view_layer.use_pass_cryptomatte_object,
        "CryptoAsset": view_layer.use_pass_cryptomatte_asset,
    }
    return {layer: [f"{layer}{k:02d}" for k in range(count)] for layer in MATTES if asked[layer]}


def enabled(scene, layer):
    """Name, channels and kind of the enabled passes."""
    found = [
        (True, "Combined", "RGBA", "COLOR"),
        (layer.use_pass_z, "Depth", "Z", "VALUE"),
        (layer.use_pass_object_index, "IndexOB", "X", "VALUE"),
        (scene.pags.use_pass_heat, "PriorityHeat", "RGBA", "COLOR"),
        (layer.use_pass_normal, "Normal", "XYZ", "VECTOR"),
        (layer.use_pass_vector, "Vector", "XYZW", "VECTOR"),
    ]
    found += [(True, name, "RGBA", "COLOR") for names in mattes(layer).values() for name in names]
    return [own for on, *own in found if on]


def outputs(layer):
    """The engine outputs required by the passes of a render layer."""
    names = {p.name for p in layer.passes}
    found = [output for name, output in (("Normal", "normal"), ("Vector", "motion")) if name in names]
    return found + [output for name, output in MATTES.items() if name + "00" in names]


def add_arguments(engine, depsgraph, frame, drawn, critical_only, arguments):
    """Adds the inputs of these outputs to the keyword arguments of Renderer.submit. drawn: for each scene the keys of its parts, and their placements."""
    wanted = arguments["outputs"]
    if "crypto_object" in wanted:
        for own, (keys, _) in zip([arguments, *arguments["others"]], drawn):
            own["names"] = [key[0] for key in keys]
    if "motion" not in wanted:
        return
    number, subframe = depsgraph.scene.frame_current, depsgraph.scene.frame_subframe
    try:
        for argument, step in (("before", -1), ("after", 1)):
            engine.frame_set(number + step, subframe)
            arguments[argument] = moment(depsgraph, frame, number + subframe + step, drawn, critical_only)
    finally:
        engine.frame_set(number, subframe)


def moment(depsgraph, frame, number, drawn, critical_only):
    """Camera, placements and other scenes at a frame of the timeline, in the order of `drawn`; parts missing at that frame keep their current place."""
    then = frame.at(gather.gather(depsgraph))
    placements = []
    for k, (keys, own) in enumerate(drawn):
        found = dict(zip(*then.parts(k, number, critical_only)))
        placements.append([found.get(key, placement) for key, placement in zip(keys, own)])
    scene = depsgraph.scene
    width, height = lens.picture_size(scene.render)
    camera = scene.camera.evaluated_get(depsgraph)
    values, pose = lens.of_camera(
        camera.data, camera.matrix_world, width, height, scene.render.pixel_aspect_x, scene.render.pixel_aspect_y
    )
    contents = then.contents(number, placements)
    return then.camera(values, pose, number), contents["placements"], contents["others"]


def planes(picture, frame):
    """The contents of the passes by name."""
    found = {}
    if picture.normal is not None:
        found["Normal"] = np.asarray(picture.normal) @ frame.turn.astype(np.float32).T
    if picture.motion is not None:
        found["Vector"] = picture.motion
    for layer, output in MATTES.items():
        matte = getattr(picture, output)
        for k in range(MOST_PASSES if matte is not None else 0):
            found[f"{layer}{k:02d}"] = np.ascontiguousarray(np.asarray(matte)[:, :, 4 * k : 4 * k + 4])
    return found


def describe(result, view_layer_name, layer, names):
    """Adds the metadata of a Cryptomatte (specification 1.2.0) to the render result, for files and Blender's node."""
    for matte in MATTES:
        if matte + "00" not in {p.name for p in layer.passes}:
            continue
        full = f"{view_layer_name}.{matte}"
        key = f"cryptomatte/{native.module.cryptomatte_hash(full):08x}"[: len("cryptomatte/") + 7]
        manifest = {name: f"{native.module.cryptomatte_hash(name):08x}" for name in sorted(names[matte])}
        texts = {
            "name": full,
            "hash": "MurmurHash3_32",
            "conversion": "uint32_to_float32",
            "manifest": json.dumps(manifest, ensure_ascii=False),
        }
        for name, text in texts.items():
            result.stamp_data_add_field(f"{key}/{name}", text)


def names(frame, drawn):
    """The names in each matte."""
    found = {"CryptoObject": set(), "CryptoAsset": set()}
    for entry, (keys, placements) in zip(frame.entries, drawn):
        found["CryptoObject"] |= {key[0] for key in keys}
        found["CryptoAsset"] |= {
            entry.objects[index]["class"] if index >= 0 else "background" for index, _ in placements
        }
    return found
