# SPDX-License-Identifier: Apache-2.0
"""Measures the labels of a panel in the interface's font: a layout that records the items tells which labels a column of
a given width cuts. Sizes are those of Blender's widgets at interface scale 1."""

import blf
import bpy

ICON, MARGIN, ARROW, CHECK = 20, 8, 14, 20  # pixels
LABEL, FIELD = 0.25, 0.4  # share of a label before its field, without and with property split


class Item:
    def __init__(self, text, more=0):
        self.text, self.more = text, more

    def needs(self):
        return (blf.dimensions(0, self.text)[0] + MARGIN if self.text else 0) + self.more

    def cut(self, width):
        return [(self.text, round(self.needs()), round(width))] if self.needs() > width else []


class Measured:
    """Replaces a panel's layout."""

    def __init__(self, kind="column", factor=0.5, split=False):
        self.kind, self.factor, self.items, self.use_property_split = kind, factor, [], split

    def inner(self, kind, factor=0.5):
        self.items.append(Measured(kind, factor or 0.5, self.use_property_split))
        return self.items[-1]

    def row(self, heading="", **_):
        return self.inner("row")

    def column(self, **_):
        return self.inner("column")

    box = column

    def split(self, factor=0.5, **_):
        return self.inner("split", factor)

    def label(self, text="", icon="NONE", **_):
        self.items.append(Item(text, ICON if icon != "NONE" else 0))

    def operator(self, name, text=None, icon="NONE", **_):
        folder, operator = name.split(".")
        known = getattr(getattr(bpy.ops, folder), operator).get_rna_type()
        self.items.append(Item(known.name if text is None else text, ICON if icon != "NONE" else 0))
        return type("Properties", (), {})()

    def operator_menu_enum(self, name, _, text=None, icon="NONE", **__):
        self.operator(name, text, icon)
        self.items[-1].more += ARROW

    def menu(self, name, text=None, icon="NONE", **_):
        self.items.append(Item(text or name, ARROW + (ICON if icon != "NONE" else 0)))

    def prop(self, data, name, text=None, icon="NONE", **_):
        member = data.bl_rna.properties[name]
        label = member.name if text is None else text
        if member.type == "BOOLEAN":
            self.items.append(Item(label, CHECK))
            return
        if member.type == "ENUM":
            field = Item(member.enum_items[getattr(data, name)].name, ARROW + MARGIN)
        elif member.type in {"INT", "FLOAT"} and not member.is_array:
            value = getattr(data, name)
            field = Item(str(value) if member.type == "INT" else f"{value:.2f}", MARGIN)
            if label and not self.use_property_split:
                field, label = Item(f"{label}  {field.text}", MARGIN), ""
        else:
            field = Item("", 30)
        if not label:
            self.items.append(field)
            return
        pair = self.inner("split", FIELD if self.use_property_split else LABEL)
        pair.items += [Item(label), field]

    def separator(self, *_, **__):
        pass

    def __getattr__(self, name):
        if not name.startswith("template_"):
            raise AttributeError(name)
        return self.separator

    def needs(self):
        found = [item.needs() for item in self.items] or [0]
        return sum(found) if self.kind in {"row", "split"} else max(found)

    def cut(self, width):
        """The labels that do not fit: (text, pixels needed, pixels there)."""
        if self.kind == "column":
            widths = [width] * len(self.items)
        elif self.kind == "split":
            rest = (1 - self.factor) * width / max(1, len(self.items) - 1)
            widths = [self.factor * width] + [rest] * (len(self.items) - 1)
        else:  # a row shares its width by the items' needs
            scale = width / max(self.needs(), 1)
            widths = [max(1.0, scale) * item.needs() if scale >= 1 else scale * item.needs() for item in self.items]
        return [cut for item, own in zip(self.items, widths) for cut in item.cut(own + 0.5)]
