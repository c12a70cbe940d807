# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel for inspecting a scene: comparison with photographs, their list, other recorded data, measuring."""

import bpy

from . import cameras, program, reasons, recording, ui


class PAGS_PT_inspect(ui.OfScene, bpy.types.Panel):
    bl_label = "Inspect"
    bl_order = 3

    def draw(self, context):
        scene, layout, root = context.scene, self.layout, cameras.root_of(context)
        settings = scene.pags
        none, lacking = reasons.photographs(context, root), program.absent(context)
        layout.label(text="Compare with photographs")
        ui.where(layout, none and settings.comparison == "NONE").prop(settings, "comparison", text="")
        ui.where(layout, none or lacking).operator("pags.rank", icon="SORT_ASC")
        if scene.pags_photographs:
            layout.prop(settings, "listed", text="")
            layout.template_list("PAGS_UL_photographs", "", scene, "pags_photographs", scene, "pags_photograph", rows=4)
        if scene.pags_photographs_said or none or lacking:
            reasons.explain(layout, scene.pags_photographs_said or none or lacking)
        ui.where(layout, none).operator("pags.compare", icon="IMAGE_DATA", text="To the image editor")
        if scene.pags_compared:
            reasons.explain(layout, scene.pags_compared)
        if settings.wipe_root is not None or reasons.several(context):
            layout.label(text="Beside")
            layout.prop(settings, "wipe_root", text="")
        if settings.comparison == "WIPE" or settings.wipe_root is not None or scene.pags_compared:
            layout.prop(settings, "wipe")


class PAGS_PT_recording(ui.OfScene, bpy.types.Panel):
    bl_label = "Recording"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, none = self.layout, reasons.recording(cameras.root_of(context))
        row = ui.where(layout.column(align=True), none)
        row.operator("pags.lidar")
        row.operator("pags.boxes")
        if any("pags_lidar" in o for o in context.scene.objects):
            layout.prop(context.scene.pags, "lidar_color", text="")
        text = "Remove held-out marks" if recording.marked(context.scene) else "Mark held-out steps"
        ui.where(layout, none).operator("pags.mark_held_out", text=text, icon="MARKER_HLT")
        if none:
            reasons.explain(layout, none)


class PAGS_PT_measure(ui.OfScene, bpy.types.Panel):
    bl_label = "Measure"
    bl_order = 5

    def draw(self, context):
        layout, scene = self.layout, context.scene
        layout.operator("pags.distance", icon="DRIVER_DISTANCE")
        if scene.pags_distance:
            row = layout.row()
            row.label(text=scene.pags_distance.split(" (")[0])
            row.operator("pags.forget_distance", text="", icon="X")
        layout.operator("pags.stand", icon="TRIA_DOWN_BAR")
        layout.operator("pags.stand_on_road", icon="TRIA_DOWN_BAR")
