# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean-up and look: live settings of a scene and of each part, applied by renders and exports. They become rules, JSON that the engine applies when it loads
a scene (docs/cleanup.md); the scene's files don't change.

Colours are display-referred sRGB, as in the scene: c' = contrast (saturation (tint * 2^(exposure / 2.2) c) - 1/2) + 1/2, one 3x4 matrix."""

import json

import bpy
import numpy as np
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty

from . import cameras, draw, lens, reasons

LUMA = np.array([0.2126, 0.7152, 0.0722])  # luminance weights of Rec. 709
LOOKS = ("exposure", "tint", "saturation", "contrast", "opacity", "sh")
LIMITS = ("least_opacity", "least_size", "greatest_size", "least_views")
SIDES = [("KEEP", "Keep inside", "Hide Gaussians outside"), ("REMOVE", "Remove inside", "Hide Gaussians inside")]


class PagsCrop(bpy.types.PropertyGroup):
    volume: draw.live(PointerProperty, "Volume", "Empty displayed as a cube or a sphere", type=bpy.types.Object)
    mode: draw.live(EnumProperty, "Crop", "Effect on the Gaussians inside", items=SIDES)


FACTOR = {"default": 1, "min": 0, "soft_max": 2, "max": 10}
LENGTH = {"min": 0, "max": 1e5, "unit": "LENGTH", "precision": 3}


class PagsLook(bpy.types.PropertyGroup):
    exposure: draw.live(FloatProperty, "Exposure", "Exposure in stops", soft_min=-5, soft_max=5, min=-20, max=20)
    tint: draw.live(
        FloatVectorProperty, "Tint", "Factor per channel", subtype="COLOR", **{**FACTOR, "default": (1, 1, 1)}
    )
    saturation: draw.live(FloatProperty, "Saturation", "Saturation: 0 is grey, 1 is unchanged", **FACTOR)
    contrast: draw.live(FloatProperty, "Contrast", "Contrast about middle grey: 1 is unchanged", **FACTOR)
    opacity: draw.live(
        FloatProperty, "Opacity", "Factor of each Gaussian's opacity; 0 hides all", **{**FACTOR, "max": 1000}
    )
    sh: draw.live(FloatProperty, "View dependence", "Factor of the view-dependent colour; 0 removes it", **FACTOR)
    least_opacity: draw.live(
        FloatProperty, "Minimum opacity", "Hide Gaussians with a lower opacity, 0 to 1", min=0, max=1, precision=3
    )
    least_size: draw.live(FloatProperty, "Minimum size", "Hide Gaussians whose largest sigma is below this", **LENGTH)
    greatest_size: draw.live(
        FloatProperty, "Maximum size", "Hide Gaussians whose largest sigma is above this; 0: none", **LENGTH
    )
    least_views: draw.live(
        IntProperty,
        "Minimum views",
        "Hide Gaussians of the background that fewer than this number of views see",
        min=0,
        max=100000,
    )
    crops: CollectionProperty(name="Crops", description="Empties that limit the visible Gaussians", type=PagsCrop)


# ---- Rules ----


def matrix_of(look):
    """The colour's 3x4 matrix, 12 numbers, or None if it is the identity."""
    if look.exposure == 0 and tuple(look.tint) == (1, 1, 1) and look.saturation == 1 and look.contrast == 1:
        return None
    grey = (1 - look.saturation) * np.tile(LUMA, (3, 1)) + look.saturation * np.eye(3)
    linear = look.contrast * grey @ np.diag(np.array(look.tint) * 2 ** (look.exposure / 2.2))
    return np.hstack([linear, np.full((3, 1), 0.5 - 0.5 * look.contrast)]).reshape(-1).tolist()


def crop_of(crop, owner, depsgraph):
    """A crop's rule, or None if its Empty is missing, is neither cube nor sphere, or has no volume."""
    volume = crop.volume
    if volume is None or volume.type != "EMPTY" or volume.empty_display_type not in {"CUBE", "SPHERE"}:
        return None
    size = np.diag([volume.empty_display_size] * 3 + [1.0])
    frame_from_unit = (
        np.linalg.inv(lens.matrix(owner.matrix_world))
        @ lens.matrix(volume.evaluated_get(depsgraph).matrix_world)
        @ size
    )
    if abs(np.linalg.det(frame_from_unit)) < 1e-12:
        return None
    return {
        "shape": "box" if volume.empty_display_type == "CUBE" else "sphere",
        "keep": crop.mode == "KEEP",
        "unit_from_frame": lens.pose12(np.linalg.inv(frame_from_unit)),
    }


def rules_of(owner, index, depsgraph, everything=False):
    """The rules (none or one) of an evaluated Blender object: of a root (whole scene), or of the part of object `index`."""
    if not owner.is_property_set("pags_look"):  # unchanged settings return early: each redraw visits thousands of parts
        return []
    look = owner.pags_look
    crops = [crop_of(crop, owner, depsgraph) for crop in owner.original.pags_look.crops]
    rule = {name: getattr(look, name) for name in LIMITS if getattr(look, name) > 0}
    rule |= {name: getattr(look, name) for name in ("opacity", "sh") if getattr(look, name) != 1}
    rule |= {"matrix": matrix_of(look), "crops": [crop for crop in crops if crop is not None]}
    rule = {name: value for name, value in rule.items() if value}
    return [rule if everything else {"object": index, **rule}] if rule else []


def text_of(rules):
    return json.dumps(rules) if rules else ""


def index_of(part):
    """The object index of a part, -1 for the background."""
    return -1 if part.pags.kind == "BACKGROUND" else part.pags.index


def parts_of(root):
    """The Blender objects that represent parts of a scene, by name."""
    return sorted(
        (o for o in bpy.data.objects if o.pags.kind in {"BACKGROUND", "OBJECT"} and o.pags.root == root),
        key=lambda o: o.name,
    )


def edits_of(root, depsgraph):
    """The rules of a scene for exports. If several Blender objects represent one part, the first by name that has rules counts."""
    found = {}
    for part in parts_of(root):
        rules = rules_of(part.evaluated_get(depsgraph), index_of(part), depsgraph)
        if rules:
            found.setdefault(index_of(part), rules)
    everything = rules_of(root.evaluated_get(depsgraph), -1, depsgraph, everything=True)
    return text_of(everything + [rule for index in sorted(found) for rule in found[index]])


def preferred(owner):
    """The other object of the same part whose settings apply instead; None if this object's own apply."""
    if owner.pags.kind == "ROOT":
        return None
    twins = [o for o in parts_of(owner.pags.root) if index_of(o) == index_of(owner)]
    if len(twins) < 2:
        return None
    depsgraph = bpy.context.evaluated_depsgraph_get()
    first = next((o for o in twins if rules_of(o.evaluated_get(depsgraph), 0, depsgraph)), owner)
    return first if first != owner else None


# ---- Operators and panel ----


def owner_of(context):
    """The object whose settings the panel shows: the active part, else the scene's root."""
    active = context.active_object
    if active is not None and active.pags.kind in {"BACKGROUND", "OBJECT", "ROOT"}:
        return active
    return cameras.root_of(context)


class OnOwner:
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return owner_of(context) is not None


class PAGS_OT_add_crop(OnOwner, bpy.types.Operator):
    """Add an Empty that crops the scene or the active object"""

    bl_idname = "pags.add_crop"
    bl_label = "Add crop"

    shape: EnumProperty(
        name="Shape",
        description="Shape of the crop volume",
        items=[("CUBE", "Box", "Box; can be rotated and stretched"), ("SPHERE", "Sphere", "Sphere; can be stretched")],
    )
    mode: EnumProperty(
        name="Crop",
        description="Side of the volume that stays visible",
        items=SIDES,
    )

    def execute(self, context):
        owner = owner_of(context)
        volume = bpy.data.objects.new(f"Crop of {owner.name}", None)
        volume.empty_display_type, volume.empty_display_size = self.shape, 1.0
        volume.location = context.scene.cursor.location
        volume.scale = (2.0, 2.0, 2.0)
        (owner.users_collection or [context.scene.collection])[0].objects.link(volume)
        crop = owner.pags_look.crops.add()
        crop.volume, crop.mode = volume, self.mode
        return {"FINISHED"}


class PAGS_OT_remove_crop(OnOwner, bpy.types.Operator):
    """Remove this crop and its Empty"""

    bl_idname = "pags.remove_crop"
    bl_label = "Remove crop"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty(name="Number", description="Number of the crop to remove", min=0)

    def execute(self, context):
        crops = owner_of(context).pags_look.crops
        if self.number >= len(crops):
            return {"CANCELLED"}
        volume = crops[self.number].volume
        crops.remove(self.number)
        if volume is not None:
            bpy.data.objects.remove(volume)
        return {"FINISHED"}


class PAGS_OT_reset_look(OnOwner, bpy.types.Operator):
    """Reset clean-up and look; crops stay"""

    bl_idname = "pags.reset_look"
    bl_label = "Reset"

    def execute(self, context):
        for name in (*LOOKS, *LIMITS):
            owner_of(context).pags_look.property_unset(name)
        owner_of(context).update_tag()  # unlike setting a property, unsetting it tells nobody
        draw.again()
        return {"FINISHED"}


class PAGS_PT_cleanup(bpy.types.Panel):
    bl_label = "Clean up and look"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PAGS"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 6

    @classmethod
    def poll(cls, context):
        return owner_of(context) is not None

    def draw(self, context):
        owner, layout = owner_of(context), self.layout
        look = owner.pags_look
        reasons.explain(layout, "Whole scene" if owner.pags.kind == "ROOT" else f"{owner.name} alone", "OBJECT_DATA")
        twin = preferred(owner)
        if twin is not None:
            reasons.explain(layout, f"{twin.name} represents the same part; its settings apply instead")
        column = layout.column(align=True)
        for name in LOOKS:
            column.prop(look, name)
        column = layout.column(align=True)
        for name in LIMITS:
            column.prop(look, name)
        for number, crop in enumerate(look.crops):
            row = layout.row(align=True)
            row.prop(crop, "volume", text="")
            row.prop(crop, "mode", text="")
            row.operator("pags.remove_crop", text="", icon="X").number = number
        row = layout.row(align=True)
        row.operator("pags.add_crop", text="Crop box", icon="CUBE").shape = "CUBE"
        row.operator("pags.add_crop", text="Crop sphere", icon="SPHERE").shape = "SPHERE"
        layout.operator("pags.reset_look", icon="LOOP_BACK")


PROPERTIES = ((bpy.types.Object, "pags_look", PointerProperty(type=PagsLook)),)
