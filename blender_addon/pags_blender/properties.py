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

from . import draw, photographs, picked, system, timing, whereabouts

KINDS = [
    ("NONE", "None", "Not part of a PAGS scene"),
    ("ROOT", "Scene", "The whole scene: its placement in Blender's world"),
    ("BACKGROUND", "Background", "All Gaussians that belong to no object"),
    ("OBJECT", "Object", "A labelled object and its Gaussians"),
    ("TRACK", "Track", "Moves an object along its recorded track"),
    ("EGO", "Ego", "Carries the cameras along the drive"),
    ("CAMERA", "Camera", "A camera of the recording"),
]
MODES = [
    ("rgb", "Colour", "The scene's colours"),
    ("priority", "Priority", "Semantic priority from dark violet (0) to pale yellow (1)"),
    ("critical", "Critical", "Vehicles, pedestrians and cyclists in orange on grey"),
    ("depth", "Depth", "Depth: light is near, dark is far; logarithmic from 1 m to 200 m"),
    (
        "size",
        "Gaussian size",
        "Largest sigma of the Gaussian with the highest weight: dark 3 mm, light 3 m, logarithmic",
    ),
    ("count", "Gaussian count", "Gaussians blended per pixel: dark 1, light 1000, logarithmic"),
    ("overdraw", "Overdraw", "Gaussians computed per pixel, a measure of cost: dark 1, light 1000, logarithmic"),
]
COMPARISONS = [
    ("NONE", "Off", "Show the rendered picture only"),
    ("WIPE", "Wipe", "Photograph left of the edge, rendered picture right of it"),
    ("DIFFERENCE", "Difference", "Difference per channel, amplified four times"),
    ("SSIM", "SSIM", "Structural similarity: dark is equal, light is different"),
]


def critical_only(settings, context):
    picked.forget()  # the picked object may be hidden now
    draw.again()


def wipe_moved(settings, context):
    photographs.wipe(context, settings.wipe)
    draw.again()


def recolor(settings, context):
    from . import sweeps

    sweeps.after_frame(settings.id_data)
    draw.again()


LISTED = [
    ("PHOTOGRAPH", "Photographs", "PSNR of each photograph, worst first"),
    ("CAMERA", "Cameras", "Mean PSNR of each camera, worst first; a click goes to its worst photograph"),
    (
        "OBJECT",
        "Objects",
        "PSNR of each object's pixels, worst first; a click goes to its worst photograph and selects it",
    ),
    (
        "GAP",
        "Track gaps",
        "Objects without labels for a while, longest first; a click goes to the gap and selects the object",
    ),
]
RELATIVE = {"options": {"PATH_SUPPORTS_BLEND_RELATIVE"}} if bpy.app.version >= (5, 0, 0) else {}  # "//" in a path
OWN = {"override": {"LIBRARY_OVERRIDABLE"}}  # for properties that an override of a linked scene may change


class PagsObject(bpy.types.PropertyGroup):
    kind: EnumProperty(
        name="Part", description="Part of the scene that this object represents", items=KINDS, default="NONE"
    )  # only the import sets it
    index: IntProperty(name="Number", description="Number of the object in the scene file", default=-1)
    root: PointerProperty(name="Scene", description="The scene's root Empty", type=bpy.types.Object, **OWN)
    # On roots only:
    path: StringProperty(
        name="Path",
        description="Scene folder or splat file",
        subtype="FILE_PATH",
        update=lambda s, _: whereabouts.chosen(s, "path"),
        **OWN,
        **RELATIVE,
    )
    relative: BoolProperty(
        name="Becomes relative",
        description="Make the path relative to the .blend when it is first saved",
        options={"HIDDEN"},
    )
    dataset: StringProperty(
        name="Data set folder",
        description="Folder with the recording's photographs and sweeps on this machine; empty: the folder used in training, or one next to the scene",
        subtype="DIR_PATH",
        update=lambda s, _: whereabouts.chosen(s, "dataset"),
        **OWN,
        **RELATIVE,
    )
    record: StringProperty(
        name="Notes",
        description="Locations and identity of scene and data set (whereabouts.py)",
        options={"HIDDEN"},
        **OWN,
    )
    frame_start: FloatProperty(
        name="First frame",
        description="Frame at which the scene begins; its keyframes move with it",
        default=1,
        precision=1,
        update=timing.chosen,
    )
    fps: FloatProperty(
        name="Frames per second",
        description="Frames of the timeline per second of the scene; its keyframes stretch with it",
        default=24,
        min=0.01,
        precision=2,
        update=timing.chosen,
    )


class PagsCamera(bpy.types.PropertyGroup):
    aspect: FloatProperty(name="fy/fx", description="Ratio of the focal lengths in pixels", default=1, min=0.1, max=10)
    width: IntProperty(name="Width", description="Width of the recording in pixels", default=0, subtype="PIXEL")
    height: IntProperty(name="Height", description="Height of the recording in pixels", default=0, subtype="PIXEL")
    sensor: IntProperty(name="Sensor", description="Number of the camera on the rig", default=-1)


class PagsScene(bpy.types.PropertyGroup):
    sh_degree: draw.live(
        IntProperty,
        "SH degree",
        "Highest degree of the spherical harmonics used for view-dependent colour",
        default=3,
        min=0,
        max=3,
    )
    antialiased: draw.live(
        EnumProperty,
        "Antialiasing",
        "Compensate opacities for the low-pass filter (Mip-Splatting)",
        items=[("SCENE", "As trained", "As stored in the scene file"), ("ON", "On", "Always"), ("OFF", "Off", "Never")],
    )
    early_z: draw.live(
        EnumProperty,
        "Early-Z",
        "Skip Gaussians hidden behind opaque surfaces before they are loaded and coloured",
        items=[
            ("off", "Off", "Render everything in view"),
            ("lossless", "Lossless", "Skip only if the picture stays the same to the bit"),
            ("bounded", "Bounded", "Skip if no colour channel changes by more than the bound"),
        ],
        default="lossless",
    )
    early_z_eps: draw.live(
        FloatProperty,
        "Bound",
        "Maximum error of a colour channel, 0 to 1",
        default=1 / 255,
        min=1e-5,
        max=0.5,
        precision=4,
    )
    exposure: draw.live(
        BoolProperty,
        "Recorded exposure",
        "Through a camera of the recording, apply that camera's exposure at that time, as found in training",
    )
    threads: draw.live(IntProperty, "Threads", "Threads of the engine; 0: all processors", default=0, min=0, max=256)
    deadline: draw.live(
        FloatProperty,
        "Deadline (ms)",
        "Maximum milliseconds per picture while something moves; reduces detail of non-critical areas first, then resolution",
        default=50,
        min=10,
        max=2000,
        precision=0,
    )
    mode: draw.live(EnumProperty, "Show", "Content of the colours in viewport and F12", items=MODES)
    hide_noncritical: BoolProperty(
        name="Critical only",
        description="Show only vehicles, pedestrians and cyclists, without background and sky",
        update=critical_only,
    )
    overlay: draw.live(
        BoolProperty,
        "Splats in Solid and Material",
        "Show the scene among the meshes in Solid and Material shading, occluded by depth",
        default=True,
    )
    points: draw.live(BoolProperty, "Points", "Show preview points where splats are not drawn", default=True)
    use_background: draw.live(BoolProperty, "Own background", "Replace the scene's sky or background with this colour")
    background: draw.live(
        FloatVectorProperty,
        "Background",
        "Background colour, as the screen shows it",
        subtype="COLOR_GAMMA",
        size=3,
        default=(0.5, 0.5, 0.5),
        min=0,
        max=1,
    )
    blur_samples: IntProperty(
        name="Samples",
        description="Pictures averaged for depth of field and motion blur in F12; each takes the time of one picture without them",
        default=32,
        min=2,
        soft_max=256,
        max=4096,
    )
    use_pass_heat: BoolProperty(name="Priority heat", description="Add a pass that shows the priority as colours")
    comparison: draw.live(
        EnumProperty,
        "Compare",
        "Overlay of a 3D view through a camera of the recording, at the times of its photographs",
        items=COMPARISONS,
    )
    listed: EnumProperty(name="List", description="Content of the list of errors", items=LISTED)
    lidar_color: EnumProperty(
        name="Colour",
        description="Colour of LiDAR points, from blue (low) to yellow (high)",
        items=[
            ("HEIGHT", "Height", "Height above the ground"),
            ("INTENSITY", "Intensity", "Intensity of the returned light, as recorded"),
            ("DISTANCE", "Distance to splats", "Distance to the surface of the splats, from 0 to 0.5 m"),
        ],
        update=recolor,
    )
    wipe_root: draw.live(
        PointerProperty,
        "Beside",
        "A second scene, shown right of the wipe's edge in the 3D views; other scenes are left of it. F12 renders all together",
        type=bpy.types.Object,
        poll=lambda settings, candidate: candidate.pags.kind == "ROOT",
    )
    wipe: FloatProperty(
        name="Wipe",
        description="Position of the edge, as a share of the width: the photograph or the first scene is left of it",
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
        description="The command-line program that exports proxies and splats; empty: the one included in the add-on",
        subtype="FILE_PATH",
    )
    budget: IntProperty(
        name="Preview points",
        description="Maximum number of points in the preview of a scene",
        default=POINTS,
        min=0,
        max=5000000,
    )

    def draw(self, context):
        self.layout.prop(self, "program")
        self.layout.prop(self, "budget")


def preferences(context):
    """The add-on's preferences, or None if a script registered the add-on without installing it."""
    addon = context.preferences.addons.get(system.ADDON)
    return addon.preferences if addon else None


def preview_budget(context):
    chosen = preferences(context)
    return chosen.budget if chosen else POINTS


PROPERTIES = (
    (bpy.types.Object, "pags", PointerProperty(type=PagsObject, **OWN)),
    (bpy.types.Camera, "pags", PointerProperty(type=PagsCamera)),
    (bpy.types.Scene, "pags", PointerProperty(type=PagsScene)),
)
