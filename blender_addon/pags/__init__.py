# SPDX-License-Identifier: GPL-3.0-or-later
"""PAGS in Blender: import a reconstructed driving scene, see it, scrub its time, move its objects, place cameras,
render.

One tree is a legacy add-on up to Blender 4.1 and an extension from 4.2 on. Layers: this file registers; engine.py,
viewport.py and overlay.py draw; gather.py turns Blender's state into what is to be drawn; native.py alone knows the C
module."""

bl_info = {
    "name": "PAGS: driving scenes as Gaussian splats",
    "author": "The PAGS authors",
    "version": (0, 0, 0),  # the build puts the engine's here
    "blender": (3, 4, 0),
    "location": "File > Import, Render engine PAGS, 3D View > Sidebar > PAGS",
    "description": "Import, edit and render Gaussian-splat driving scenes with the PAGS engine",
    "category": "Import-Export",
}

from . import (
    cameras,
    cleanup,
    comparison,
    composite,
    engine,
    exporter,
    handlers,
    importer,
    inspect_panel,
    inspector,
    jobs,
    legend,
    measure,
    native_splats,
    overlay,
    picked,
    properties,
    proxies,
    recording,
    select_tool,
    ui,
    watch,
)

PARTS = (properties, cleanup, jobs, importer, cameras, engine, overlay, inspector, select_tool, comparison, measure, recording, composite)
PARTS += (exporter, native_splats, proxies, legend, picked, ui, inspect_panel, handlers, watch)


def register():
    for part in PARTS:
        part.register()


def unregister():
    for part in reversed(PARTS):
        part.unregister()
