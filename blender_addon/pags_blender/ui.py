# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: the 3D view's sidebar, the render engine's settings and passes, and the properties of a scene's object."""

import textwrap

import bpy
from bl_operators.presets import AddPresetBase

from . import blur, cameras, jobs, native, native_splats, overlay, photographs, program, reasons, whereabouts


class Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PAGS"


class OfScene(Sidebar):
    """Base of the panels shown once the file has a PAGS scene."""

    @classmethod
    def poll(cls, context):
        return cameras.root_of(context) is not None


def where(layout, reason):
    """A row that is disabled if there is a reason, which `reasons.explain` shows below it."""
    row = layout.row()
    row.enabled = not reason
    return row


class PAGS_PT_scene(Sidebar, bpy.types.Panel):
    bl_label = "PAGS scene"
    bl_order = 0

    def draw(self, context):
        layout, root = self.layout, cameras.root_of(context)
        if not native.module:
            reasons.explain(layout, native.problem, "ERROR")
        if root is None:
            layout.operator("import_scene.pags", icon="IMPORT")
            return
        layout.prop(root.pags, "path", text="")
        try:
            entry = native.entry(whereabouts.absolute_path(root), False)
        except native.SceneError as error:
            reasons.explain(layout, str(error), "ERROR")
        else:
            if entry.scene is not None:
                reasons.explain(layout, entry.counts(), "OUTLINER_OB_POINTCLOUD")
        layout.operator("pags.reload", icon="FILE_REFRESH")
        column = layout.column(align=True)
        column.prop(root.pags, "frame_start")
        column.prop(root.pags, "fps")


class PAGS_PT_show(OfScene, bpy.types.Panel):
    bl_label = "Show"
    bl_order = 1

    def draw(self, context):
        """Settings that apply to the shading of this 3D view."""
        settings, layout, shading = context.scene.pags, self.layout, context.space_data.shading.type
        layout.prop(settings, "mode", text="")
        none = reasons.critical(context)
        where(layout, none and not settings.hide_noncritical).prop(settings, "hide_noncritical")
        if none and (settings.hide_noncritical or settings.mode == "critical"):
            reasons.explain(layout, none)
        if shading != "WIREFRAME" and (shading != "RENDERED" or context.scene.render.engine != "PAGS"):
            layout.prop(settings, "overlay", text="Splats among meshes")
        if overlay.draws(context):
            layout.prop(settings, "deadline")
        elif shading != "RENDERED":
            layout.prop(settings, "points", text="Preview points")
        layout.separator()
        layout.operator("pags.pick", icon="EYEDROPPER")
        if context.scene.pags_picked:
            lines = layout.column(align=True)
            for line in context.scene.pags_picked.split(", "):
                for part in textwrap.wrap(line, 34):
                    lines.label(text=part)


class PAGS_PT_cameras(OfScene, bpy.types.Panel):
    bl_label = "Cameras"
    bl_order = 2

    def draw(self, context):
        layout, root = self.layout, cameras.root_of(context)
        none, parked = reasons.photographs(context, root), reasons.drive(context, root)
        row = where(layout.column(align=True), none)
        row.operator("pags.jump", text="", icon="TRIA_LEFT").step = -1
        row.operator("pags.jump", text="Nearest photograph").step = 0
        row.operator("pags.jump", text="", icon="TRIA_RIGHT").step = 1
        layout.operator("pags.camera_here", icon="CAMERA_DATA")
        where(layout, parked).operator("pags.ego_path", icon="CURVE_PATH")
        layout.operator("pags.size_of_camera", icon="FULLSCREEN_ENTER")
        where(layout, none).operator("pags.photographs", icon="IMAGE_BACKGROUND")
        if none or parked:
            reasons.explain(layout, none or parked)
        if not none:
            layout.label(text="Data set folder")
            layout.prop(root.pags, "dataset", text="")
        row = layout.row(align=True)
        row.operator("export_scene.pags_path", text="Write path")
        row.operator("import_scene.pags_path", text="Read path")


class PAGS_PT_export(OfScene, bpy.types.Panel):
    bl_label = "Export and composite"
    bl_order = 8
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        absent, single = program.absent(context), reasons.folder(cameras.root_of(context))
        where(layout, absent).operator("export_scene.pags", icon="EXPORT")
        where(layout, single).operator("pags.save_edited", icon="FILE_TICK")
        layout.operator("pags.composite", icon="NODE_COMPOSITING")
        if "pags_before" in context.scene:
            layout.operator("pags.remove_composite", icon="X")
        newer = native_splats.missing()
        where(layout, newer).operator("pags.native_splats", icon="POINTCLOUD_DATA")
        for said in dict.fromkeys(filter(None, (absent, single, newer))):
            reasons.explain(layout, said)


class PAGS_PT_object(bpy.types.Panel):
    bl_label = "PAGS"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.pags.kind != "NONE"

    def draw(self, context):
        for line in facts(context.object):
            self.layout.label(text=line)


def facts(block):
    """Facts on an object of a PAGS scene, one per line. Its kind is read-only: the scene depends on it."""
    kind = block.pags.bl_rna.properties["kind"].enum_items[block.pags.kind]
    told = {
        "class": str,
        "id": str,
        "critical": lambda value: "yes" if value else "no",
        "gaussians": "{:,}".format,
        "size": lambda value: " x ".join(f"{v:.2f}" for v in value) + " m",
    }
    found = [f"{kind.name}: {kind.description}"]
    found += [f"Scene: {block.pags.root.name}"] if block.pags.root is not None else []
    return found + [f"{k.title()}: {say(block['pags_' + k])}" for k, say in told.items() if "pags_" + k in block]


class RenderPanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"PAGS"}

    @classmethod
    def poll(cls, context):
        return context.engine == "PAGS"


class PAGS_MT_presets(bpy.types.Menu):
    bl_label = "PAGS presets"
    preset_subdir = "pags/render"
    preset_operator = "script.execute_preset"
    draw = bpy.types.Menu.draw_preset


class PAGS_OT_add_preset(AddPresetBase, bpy.types.Operator):
    """Save these settings as a preset"""

    bl_idname = "pags.add_preset"
    bl_label = "Add PAGS preset"
    preset_menu = "PAGS_MT_presets"
    preset_defines = ["settings = bpy.context.scene.pags"]
    preset_values = [
        f"settings.{name}"
        for name in "sh_degree antialiased early_z early_z_eps deadline blur_samples use_background background".split()
    ]
    preset_subdir = "pags/render"


class PAGS_PT_settings(RenderPanel, bpy.types.Panel):
    bl_label = "PAGS"

    def draw(self, context):
        layout, settings = self.layout, context.scene.pags
        layout.use_property_split = True
        row = layout.row(align=True)
        row.menu("PAGS_MT_presets", text=PAGS_MT_presets.bl_label)
        row.operator("pags.add_preset", text="", icon="ADD")
        row.operator("pags.add_preset", text="", icon="REMOVE").remove_active = True
        plain, unexposed, none = reasons.harmonics(context), reasons.exposure(context), reasons.critical(context)
        where(layout, plain).prop(settings, "sh_degree")
        layout.prop(settings, "antialiased")
        layout.prop(settings, "early_z")
        if settings.early_z == "bounded":
            layout.prop(settings, "early_z_eps")
        layout.prop(settings, "mode")
        where(layout, none and not settings.hide_noncritical).prop(settings, "hide_noncritical")
        where(layout, unexposed).prop(settings, "exposure")
        layout.prop(settings, "threads")
        layout.prop(settings, "deadline")
        row = layout.row(heading="Background")
        row.prop(settings, "use_background", text="")
        own = row.row()
        own.active = settings.use_background
        own.prop(settings, "background", text="")
        layout.prop(context.scene.render, "film_transparent", text="Transparent sky")
        for what, why in (("", plain), ("Critical only: ", none), ("Recorded exposure: ", unexposed)):
            if why:
                reasons.explain(layout, what + why, width=48)


class PAGS_PT_blur(RenderPanel, bpy.types.Panel):
    bl_label = "Depth of field and motion blur"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, render = self.layout, context.scene.render
        layout.use_property_split = True
        layout.label(text="Depth of field is a setting of the camera")
        layout.prop(context.scene.pags, "blur_samples")
        layout.prop(render, "use_motion_blur")
        column = layout.column()
        column.active = render.use_motion_blur
        column.prop(blur.position_holder(context.scene), "motion_blur_position")
        column.prop(render, "motion_blur_shutter")
        column.template_curve_mapping(render, "motion_blur_shutter_curve")


PASSES = {"z": "Depth", "object_index": "Object index", "normal": "Normal", "vector": "Vector (motion)"}
PASSES |= {"cryptomatte_object": "Cryptomatte of objects", "cryptomatte_asset": "Cryptomatte of classes"}


class PAGS_PT_passes(RenderPanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        for name, text in PASSES.items():
            layout.prop(context.view_layer, f"use_pass_{name}", text=text)
        layout.prop(context.scene.pags, "use_pass_heat")


class PAGS_OT_photographs(cameras.OfRecording, jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the recording's photographs as the active camera's background, along the timeline"""

    bl_idname = "pags.photographs"
    bl_label = "Show photographs"

    def steps(self, context, root):
        camera = context.scene.camera
        return lambda job: photographs.show(job, camera, camera.pags.root)
