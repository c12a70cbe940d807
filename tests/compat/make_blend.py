# SPDX-License-Identifier: Apache-2.0
"""blender -b -P make_blend.py -- ADDON.zip SCENE OUT.blend: installs an add-on, imports a scene and saves the file."""

import os
import sys
import zipfile

import bpy

package, scene, out = (os.path.abspath(path) for path in sys.argv[sys.argv.index("--") + 1 :][:3])
bpy.ops.preferences.addon_install(filepath=package)
module = next(name.split("/")[0] for name in zipfile.ZipFile(package).namelist() if name.endswith("/__init__.py"))
bpy.ops.preferences.addon_enable(module=module)
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
bpy.ops.preferences.addon_enable(module=module)
bpy.ops.wm.save_as_mainfile(filepath=out)  # the saved path of the scene is relative to the .blend file
bpy.ops.import_scene.pags(filepath=scene)
bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 64, 36
bpy.ops.wm.save_as_mainfile(filepath=out, compress=True, relative_remap=True)
print("objects:", sorted(item.name for item in bpy.data.objects), "engine:", bpy.context.scene.render.engine)
