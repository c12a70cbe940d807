# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: the 3D view's sidebar, the render engine's settings and passes, and the properties of a scene's object."""

import bpy
from bl_operators.presets import AddPresetBase

from . import blur, cameras, exporter, jobs, native, photographs, program


class Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PAGS"


class PAGS_PT_scene(Sidebar, bpy.types.Panel):
    bl_label = "PAGS scene"

    def draw(self, context):
        layout, root = self.layout, cameras.root_of(context)
        if not native.module:
            layout.label(text=native.problem, icon="ERROR")
        if root is None:
            layout.operator("import_scene.pags", icon="IMPORT")
            return
        layout.prop(root.pags, "path", text="")
        try:
            entry = native.entry(native.absolute_path(root), False)
        except native.SceneError as error:
            layout.label(text=str(error), icon="ERROR")
        else:
            if entry.scene is not None:
                layout.label(text=f"{entry.info['gaussians']:,} Gaussians, {len(entry.objects)} objects")
        layout.operator("pags.reload", icon="FILE_REFRESH")
        row = layout.row(align=True)
        row.prop(root.pags, "frame_start")
        row.prop(root.pags, "fps")


class PAGS_PT_show(Sidebar, bpy.types.Panel):
    bl_label = "Show"

    def draw(self, context):
        settings, layout = context.scene.pags, self.layout
        layout.prop(settings, "mode")
        layout.prop(settings, "hide_noncritical")
        layout.prop(settings, "overlay")
        layout.prop(settings, "points")
        layout.prop(settings, "deadline")
        layout.separator()
        layout.operator("pags.pick", icon="EYEDROPPER")
        if context.scene.pags_picked:
            lines = layout.column(align=True)
            for line in context.scene.pags_picked.split(", "):
                lines.label(text=line)


class PAGS_PT_cameras(Sidebar, bpy.types.Panel):
    bl_label = "Cameras"

    def draw(self, context):
        layout = self.layout
        row = layout.row(align=True)
        row.operator("pags.jump", text="Previous", icon="TRIA_LEFT").step = -1
        row.operator("pags.jump", text="Nearest").step = 0
        row.operator("pags.jump", text="Next", icon="TRIA_RIGHT").step = 1
        layout.operator("pags.camera_here", icon="CAMERA_DATA")
        layout.operator("pags.ego_path", icon="CURVE_PATH")
        layout.operator("pags.size_of_camera")
        layout.operator("pags.photographs", icon="IMAGE_BACKGROUND")
        root = cameras.root_of(context)
        if root is not None:
            layout.prop(root.pags, "dataset")
        row = layout.row(align=True)
        row.operator("export_scene.pags_path", text="Write path")
        row.operator("import_scene.pags_path", text="Read path")


class PAGS_PT_export(Sidebar, bpy.types.Panel):
    bl_label = "Export and composite"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        row = layout.row()
        row.enabled = not program.absent(context)
        row.operator("export_scene.pags", icon="EXPORT")
        layout.operator("pags.save_edited", icon="FILE_TICK")
        lacking, row = program.lacking(context), layout.row()
        row.enabled = not lacking
        row.operator_menu_enum("pags.import_proxies", "level", icon="MESH_DATA")
        if lacking:
            exporter.explain(layout, lacking)
        layout.operator("pags.composite", icon="NODE_COMPOSITING")
        layout.operator("pags.native_splats", icon="POINTCLOUD_DATA")


class PAGS_PT_object(bpy.types.Panel):
    bl_label = "PAGS"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.pags.kind != "NONE"

    def draw(self, context):
        block, layout = context.object, self.layout
        layout.prop(block.pags, "kind")
        if block.pags.root is not None:
            layout.label(text=f"Scene: {block.pags.root.name}")
        for key, label in (
            ("pags_class", "Class"),
            ("pags_id", "Id"),
            ("pags_critical", "Critical"),
            ("pags_gaussians", "Gaussians"),
        ):
            if key in block:
                layout.label(text=f"{label}: {block[key]}")


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
    """Keep these settings as a preset"""

    bl_idname = "pags.add_preset"
    bl_label = "Add PAGS preset"
    preset_menu = "PAGS_MT_presets"
    preset_defines = ["settings = bpy.context.scene.pags"]
    preset_values = [
        "settings.sh_degree",
        "settings.antialiased",
        "settings.early_z",
        "settings.early_z_eps",
        "settings.exact",
        "settings.deadline",
        "settings.blur_samples",
        "settings.use_background",
        "settings.background",
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
        for name in ("sh_degree", "antialiased", "early_z"):
            layout.prop(settings, name)
        if settings.early_z == "bounded":
            layout.prop(settings, "early_z_eps")
        for name in ("mode", "hide_noncritical", "exposure", "threads", "exact", "deadline"):
            layout.prop(settings, name)
        row = layout.row(heading="Background")
        row.prop(settings, "use_background", text="")
        own = row.row()
        own.active = settings.use_background
        own.prop(settings, "background", text="")
        layout.prop(context.scene.render, "film_transparent", text="Transparent sky")


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


class PAGS_PT_passes(RenderPanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(context.view_layer, "use_pass_z", text="Depth")
        layout.prop(context.view_layer, "use_pass_object_index", text="Object index")
        layout.prop(context.scene.pags, "use_pass_heat")
        layout.prop(context.view_layer, "use_pass_normal", text="Normal")
        layout.prop(context.view_layer, "use_pass_vector", text="Vector (motion)")
        layout.prop(context.view_layer, "use_pass_cryptomatte_object", text="Cryptomatte of objects")
        layout.prop(context.view_layer, "use_pass_cryptomatte_asset", text="Cryptomatte of classes")


class PAGS_OT_reload(bpy.types.Operator):
    """Read the scene from its files again"""

    bl_idname = "pags.reload"
    bl_label = "Reload"

    def execute(self, context):
        from . import comparison, overlay, recording, viewport

        native.forget()
        comparison.forget()
        recording.forget()
        overlay.forget()
        for view in list(viewport.views):
            view.drop()
        return {"FINISHED"}


class PAGS_OT_photographs(jobs.Long, cameras.OnScene, bpy.types.Operator):
    """Show the recording's photographs behind what the active camera sees, along the timeline"""

    bl_idname = "pags.photographs"
    bl_label = "Show photographs"

    @classmethod
    def poll(cls, context):
        camera = context.scene.camera
        cls.poll_message_set("the scene's camera is none of the recording's; Nearest chooses one")
        return camera is not None and camera.pags.kind == "CAMERA" and camera.data.pags.sensor >= 0

    def steps(self, context, root):
        camera = context.scene.camera
        return lambda job: photographs.show(job, camera, camera.pags.root)


CLASSES = (
    PAGS_OT_reload,
    PAGS_OT_photographs,
    PAGS_MT_presets,
    PAGS_OT_add_preset,
    PAGS_PT_scene,
    PAGS_PT_show,
    PAGS_PT_cameras,
    PAGS_PT_export,
    PAGS_PT_object,
    PAGS_PT_settings,
    PAGS_PT_blur,
    PAGS_PT_passes,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
