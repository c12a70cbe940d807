# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel for inspecting a scene: comparison with photographs, their list, other recorded data, measuring."""

import bpy

from . import cameras, program, reasons, recording, ui


class PAGS_PT_inspect(ui.OfScene, bpy.types.Panel):
    bl_label = "Inspect"

    def draw(self, context):
        settings, manager, layout, root = (
            context.scene.pags,
            context.window_manager,
            self.layout,
            cameras.root_of(context),
        )
        none, lacking = reasons.photographs(context, root), program.absent(context)
        ui.where(layout, none and settings.comparison == "NONE").prop(settings, "comparison")
        ui.where(layout, none or lacking).operator("pags.rank", icon="SORT_ASC")
        if manager.pags_photographs:
            layout.template_list(
                "PAGS_UL_photographs", "", manager, "pags_photographs", manager, "pags_photograph", rows=4
            )
        if manager.pags_photographs_said or none or lacking:
            reasons.explain(layout, manager.pags_photographs_said or none or lacking)
        ui.where(layout, none).operator("pags.compare", icon="IMAGE_DATA", text="To the image editor")
        if context.scene.pags_compared:
            reasons.explain(layout, context.scene.pags_compared)
        if settings.wipe_root is not None or reasons.several(context):
            layout.prop(settings, "wipe_root")
        if settings.comparison == "WIPE" or settings.wipe_root is not None or context.scene.pags_compared:
            layout.prop(settings, "wipe")


class PAGS_PT_recording(ui.OfScene, bpy.types.Panel):
    bl_label = "Recording"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, none = self.layout, reasons.recording(cameras.root_of(context))
        row = ui.where(layout.column(align=True), none)
        row.operator("pags.lidar")
        row.operator("pags.boxes")
        text = "Remove held-out marks" if recording.marked(context.scene) else "Mark held-out steps"
        ui.where(layout, none).operator("pags.mark_held_out", text=text, icon="MARKER_HLT")
        if none:
            reasons.explain(layout, none)


class PAGS_PT_measure(ui.OfScene, bpy.types.Panel):
    bl_label = "Measure"

    def draw(self, context):
        layout, scene = self.layout, context.scene
        layout.operator("pags.distance", icon="DRIVER_DISTANCE")
        if scene.pags_distance:
            row = layout.row()
            row.label(text=scene.pags_distance.split(" (")[0])
            row.operator("pags.forget_distance", text="", icon="X")
        layout.operator("pags.stand", icon="TRIA_DOWN_BAR")


CLASSES = (PAGS_PT_inspect, PAGS_PT_recording, PAGS_PT_measure)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
