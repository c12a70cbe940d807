# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel on inspecting a scene: comparison with photographs, their list, what else the recording holds, measuring."""

import bpy

from . import cameras, program, recording, ui


class PAGS_PT_inspect(ui.Sidebar, bpy.types.Panel):
    bl_label = "Inspect"

    def draw(self, context):
        settings, manager, layout = context.scene.pags, context.window_manager, self.layout
        layout.prop(settings, "comparison")
        layout.prop(settings, "wipe")
        lacking = program.absent(context)
        row = layout.row()
        row.enabled = not lacking
        row.operator("pags.rank", icon="SORT_ASC")
        if manager.pags_photographs:
            layout.template_list("PAGS_UL_photographs", "", manager, "pags_photographs", manager, "pags_photograph", rows=4)
        if manager.pags_photographs_said or lacking:
            layout.label(text=manager.pags_photographs_said or lacking, icon="INFO")
        layout.operator("pags.compare", icon="IMAGE_DATA", text="To the image editor")
        if context.scene.pags_compared:
            layout.label(text=context.scene.pags_compared)
        layout.prop(settings, "wipe_root")


class PAGS_PT_recording(ui.Sidebar, bpy.types.Panel):
    bl_label = "Recording"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return cameras.root_of(context) is not None

    def draw(self, context):
        layout = self.layout
        row = layout.row(align=True)
        row.operator("pags.lidar")
        row.operator("pags.boxes")
        text = "Remove held-out marks" if recording.marked(context.scene) else "Mark held-out steps"
        layout.operator("pags.mark_held_out", text=text, icon="MARKER_HLT")


class PAGS_PT_measure(ui.Sidebar, bpy.types.Panel):
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
