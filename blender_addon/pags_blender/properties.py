# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties that the add-on stores in .blend files, and its preferences."""

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import draw, photographs, picked, system, whereabouts

KINDS = [
    ("NONE", "None", "Not of a PAGS scene"),
    ("ROOT", "Scene", "The scene itself: where its world lies in Blender's"),
    ("BACKGROUND", "Background", "Everything that belongs to no object"),
    ("OBJECT", "Object", "A labelled object and its Gaussians"),
    ("TRACK", "Track", "Carries an object along its recorded track"),
    ("EGO", "Ego", "Carries the cameras along the drive"),
    ("CAMERA", "Camera", "A camera of the recording"),
]
MODES = [
    ("rgb", "Colour", "The scene as it looks"),
    ("priority", "Priority", "Semantic priority S_sem from dark violet (0) to pale yellow (1)"),
    ("critical", "Critical", "Vehicles, pedestrians and cyclists in orange over grey"),
    ("depth", "Depth", "Near is light, far is dark; logarithmic from 1 m to 200 m"),
    ("size", "Gaussian size", "Largest sigma of the Gaussian that weighs most: dark 3 mm, light 3 m, logarithmic"),
    ("count", "Gaussian count", "Gaussians blended into each pixel: dark 1, light 1000, logarithmic"),
    ("overdraw", "Overdraw", "Gaussians computed for each pixel, what it costs: dark 1, light 1000, logarithmic"),
]
COMPARISONS = [
    ("NONE", "Off", "Draw the engine's picture alone"),
    ("WIPE", "Wipe", "The photograph left of the edge, the engine's picture right of it"),
    ("DIFFERENCE", "Difference", "How far they are apart in each channel, four times as bright"),
    ("SSIM", "SSIM", "Structural similarity: dark where they are alike, light where they are not"),
]


def draw_again(settings, context):
    """Redraws the views after a change of a property, by a script as well."""
    for _, region in draw.regions():
        region.tag_redraw()


def critical_only(settings, context):
    picked.forget()  # what was picked may not be drawn now
    draw_again(settings, context)


def wipe_moved(settings, context):
    photographs.wipe(context, settings.wipe)
    draw_again(settings, context)


RELATIVE = {"options": {"PATH_SUPPORTS_BLEND_RELATIVE"}} if bpy.app.version >= (5, 0, 0) else {}  # "//" in a path
OWN = {"override": {"LIBRARY_OVERRIDABLE"}}  # of a property that an override of a linked scene can change


class PagsObject(bpy.types.PropertyGroup):
    kind: EnumProperty(name="Part", description="What it stands for", items=KINDS, default="NONE")  # set by the import alone
    index: IntProperty(name="Number", description="Of the object in the scene file", default=-1)
    root: PointerProperty(name="Scene", description="The Empty that the scene hangs from", type=bpy.types.Object, **OWN)
    # On roots only:
    path: StringProperty(
        name="Path", description="Scene folder or splat file", subtype="FILE_PATH", update=lambda s, _: whereabouts.chosen(s, "path"), **OWN, **RELATIVE
    )
    relative: BoolProperty(
        name="Becomes relative", description="At the first save the path becomes one relative to the .blend", options={"HIDDEN"}
    )
    dataset: StringProperty(
        name="Data set folder",
        description="Where the recording's photographs and sweeps are on this machine; empty: where training read them, or beside the scene",
        subtype="DIR_PATH",
        update=lambda s, _: whereabouts.chosen(s, "dataset"),
        **OWN,
        **RELATIVE,
    )
    record: StringProperty(name="Notes", description="Where scene and data set were, and what they were (whereabouts.py)", options={"HIDDEN"}, **OWN)
    frame_start: FloatProperty(name="First frame", description="Frame at which the scene begins", default=1, precision=1, **OWN)
    fps: FloatProperty(
        name="Frames a second", description="Frames of the timeline in a second of the scene", default=24, min=0.01, precision=2, **OWN
    )


class PagsCamera(bpy.types.PropertyGroup):
    aspect: FloatProperty(name="fy/fx", description="Ratio of the focal lengths in pixels", default=1, min=0.1, max=10)
    width: IntProperty(name="Width", description="Of the recording, pixels", default=0, subtype="PIXEL")
    height: IntProperty(name="Height", description="Of the recording, pixels", default=0, subtype="PIXEL")
    sensor: IntProperty(name="Sensor", description="Number of the camera on the rig", default=-1)


class PagsScene(bpy.types.PropertyGroup):
    sh_degree: IntProperty(
        name="SH degree", description="Highest degree of view-dependent colour used", default=3, min=0, max=3,
        update=draw_again,
    )
    antialiased: EnumProperty(
        name="Antialiasing",
        description="Whether opacities are scaled by what the low-pass filter takes (Mip-Splatting)",
        items=[("SCENE", "As trained", "As the scene file says"), ("ON", "On", "Always"), ("OFF", "Off", "Never")],
        update=draw_again,
    )
    early_z: EnumProperty(
        name="Early-Z",
        description="Leave out what solid things hide before it is read and coloured",
        items=[
            ("off", "Off", "Draw everything in view"),
            ("lossless", "Lossless", "The same picture to the bit"),
            ("bounded", "Bounded", "No colour channel off by more than the bound"),
        ],
        default="lossless",
        update=draw_again,
    )
    early_z_eps: FloatProperty(
        name="Bound",
        description="Largest error of a colour channel, 0 to 1",
        default=1 / 255,
        min=1e-5,
        max=0.5,
        precision=4,
        update=draw_again,
    )
    exposure: BoolProperty(
        name="Recorded exposure",
        description="Through a camera of the recording, expose as training found that camera to expose at that time",
        update=draw_again,
    )
    threads: IntProperty(
        name="Threads", description="Threads of the engine; 0: all processors", default=0, min=0, max=256,
        update=draw_again,
    )
    deadline: FloatProperty(
        name="Deadline (ms)",
        description="Milliseconds a picture may take while something moves; detail of what is not critical is given up to keep it, then resolution",
        default=50,
        min=10,
        max=2000,
        precision=0,
        update=draw_again,
    )
    mode: EnumProperty(
        name="Show",
        description="What the colours of the viewport and of F12 mean",
        items=MODES,
        update=draw_again,
    )
    hide_noncritical: BoolProperty(
        name="Critical only", description="Draw vehicles, pedestrians and cyclists alone, without background and sky", update=critical_only
    )
    overlay: BoolProperty(
        name="Splats in Solid and Material",
        description="Draw the scene among the meshes in Solid and Material shading, each hiding what is behind it",
        default=True,
        update=draw_again,
    )
    points: BoolProperty(
        name="Points", description="Draw the light preview points where the splats aren't drawn", default=True,
        update=draw_again,
    )
    use_background: BoolProperty(
        name="Own background", description="This colour behind everything, in place of the scene's sky or background",
        update=draw_again,
    )
    background: FloatVectorProperty(
        name="Background", description="Colour behind everything, as the screen shows it", subtype="COLOR_GAMMA",
        size=3, default=(0.5, 0.5, 0.5), min=0, max=1, update=draw_again,
    )
    blur_samples: IntProperty(
        name="Samples",
        description="Pictures of which depth of field and motion blur are the mean in F12; each takes as long as a picture without them",
        default=32,
        min=2,
        soft_max=256,
        max=4096,
    )
    use_pass_heat: BoolProperty(name="Priority heat", description="A pass with the priority as colours")
    comparison: EnumProperty(
        name="Compare",
        description="What a 3D view that looks through a camera of the recording shows over it, at the times of its photographs",
        items=COMPARISONS,
        update=draw_again,
    )
    wipe_root: PointerProperty(
        name="Beside",
        description="A second scene, drawn right of the wipe's edge in the 3D views; the others are drawn left of it. F12 draws all together",
        type=bpy.types.Object,
        poll=lambda settings, candidate: candidate.pags.kind == "ROOT",
        update=draw_again,
    )
    wipe: FloatProperty(
        name="Wipe",
        description="Where the edge is: the share of the width that the photograph, or the first scene, has from the left",
        default=0.5,
        min=0,
        max=1,
        subtype="FACTOR",
        update=wipe_moved,
    )


POINTS = 60000


class PagsPreferences(bpy.types.AddonPreferences):
    bl_idname = system.ADDON

    program: StringProperty(
        name="pags program",
        description="The command-line program that exports proxies and splats; empty: the one that the add-on brings",
        subtype="FILE_PATH",
    )
    budget: IntProperty(
        name="Preview points",
        description="At most so many points in all for the preview of a scene",
        default=POINTS,
        min=0,
        max=5000000,
    )

    def draw(self, context):
        self.layout.prop(self, "program")
        self.layout.prop(self, "budget")


def preferences(context):
    """The add-on's preferences, or None where a script registered the add-on by hand."""
    addon = context.preferences.addons.get(system.ADDON)
    return addon.preferences if addon else None


def preview_budget(context):
    chosen = preferences(context)
    return chosen.budget if chosen else POINTS


CLASSES = (PagsObject, PagsCamera, PagsScene, PagsPreferences)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.pags = PointerProperty(type=PagsObject, **OWN)
    bpy.types.Camera.pags = PointerProperty(type=PagsCamera)
    bpy.types.Scene.pags = PointerProperty(type=PagsScene)


def unregister():
    del bpy.types.Scene.pags
    del bpy.types.Camera.pags
    del bpy.types.Object.pags
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
